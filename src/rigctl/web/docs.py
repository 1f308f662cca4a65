"""The documentation site, served without a network; in a checkout without it, the pages as written."""

from __future__ import annotations

import base64
import hashlib
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

from starlette.responses import Response

from rigctl.errors import RigctlError
from rigctl.files.shipped import shipped
from rigctl.web.request_handling import PageRequest, get
from rigctl.web.server_state import PagePart, Site

if TYPE_CHECKING:
    from starlette.routing import BaseRoute

#: by ending; a computer's own list of kinds may call a script a text, which browsers do not run
_KINDS: Final = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css",
    ".js": "text/javascript",
    ".json": "application/json",
    ".svg": "image/svg+xml",
    ".png": "image/png",
}
_LINK: Final = re.compile(r"\]\(((?:tutorial|how-to|reference|explanation)/[^)#]+\.md)\)")
_INLINE: Final = re.compile(r"<script(?![^>]*\bsrc=)[^>]*>(.*?)</script>", re.DOTALL)


def site_folder() -> Path | None:
    """The built site: in a wheel that carries it, or in a checkout where it was made; None elsewhere."""
    for parts in (("site",), ("build", "site")):
        folder = shipped(*parts)
        if (folder / "index.html").is_file():
            return folder
    return None


def written_pages() -> list[dict[str, str]]:
    """Path and title of the pages of a checkout, in the order of their links on the first page."""
    folder = shipped("docs")
    first = folder / "README.md"
    if not first.is_file():
        return []
    named = dict.fromkeys(_LINK.findall(first.read_text(encoding="utf-8")))
    pages = {path: folder / path for path in named if (folder / path).is_file()}
    titles = {path: file.read_text(encoding="utf-8").partition("\n")[0] for path, file in pages.items()}
    return [{"path": path, "title": title.lstrip("# ")} for path, title in titles.items()]


def routes(_: Site) -> Sequence[BaseRoute]:
    """The routes of the page: whether the site exists or which pages do, and the files."""
    return (
        get("/api/docs", lambda _: {"there": site_folder() is not None, "pages": written_pages()}),
        get("/docs/{path:path}", page),
    )


def page(request: PageRequest) -> Response:
    """A file of the site, or a page as it is written.

    Raises
    ------
    RigctlError
        the site was not built, or has no such file.
    """
    folder, path = site_folder() or shipped("docs"), request.text("path") or "index.html"
    file = (folder / path).resolve() if "\0" not in path else None
    if file is None or not file.is_relative_to(folder.resolve()) or not file.is_file():
        raise RigctlError("the documentation has no such page", value=path)
    content = file.read_bytes()
    html = file.suffix == ".html"
    headers = {"content-security-policy": policy(content.decode("utf-8"))} if html else {}
    return Response(content, media_type=_KINDS.get(file.suffix, "text/plain; charset=utf-8"), headers=headers)


def policy(html: str) -> str:
    """The policy for a page of the site: its own scripts run, inline ones by their hashes."""
    hashes = {hashlib.sha256(script.encode("utf-8")).digest() for script in _INLINE.findall(html)}
    allowed = " ".join(sorted(f"'sha256-{base64.b64encode(one).decode('ascii')}'" for one in hashes))
    return (
        f"default-src 'none'; script-src 'self' {allowed}; style-src 'self' 'unsafe-inline'; "
        f"img-src 'self' data:; font-src 'self'; connect-src 'self'; worker-src 'self'; base-uri 'none'; "
        f"form-action 'none'; frame-ancestors 'self'"
    )


PART = PagePart("docs", "Docs", "How to work with rigctl.", routes)
