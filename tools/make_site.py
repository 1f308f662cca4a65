"""The documentation site, written by ``make site`` to ``build/site`` unless a link is broken.

The pages are those of ``docs``, in the order of its start page, and linked files outside of ``docs``. They
are copied with adapted links, and built from the copy: the builder needs only a folder of Markdown and
``mkdocs.yml``, and can be replaced.
"""

from __future__ import annotations

import argparse
import json
import os
import posixpath
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
#: folder of docs -> its tab, in this order
TABS = {"tutorial": "Tutorials", "how-to": "How-to", "reference": "Reference", "explanation": "Explanation"}
#: pages outside of docs -> their place on the site
OUTSIDE = {
    "CHANGELOG.md": "project/changelog.md",
    "CONTRIBUTING.md": "project/contributing.md",
    "data/README.md": "project/data.md",
    "firmware/README.md": "project/firmware.md",
}
#: a folder has no page
FOLDERS = {"docs/decisions": "docs/decisions/index.md"}
_LINK = re.compile(r"\]\(([^)\s#]+)(#[^)\s]*)?\)")
_ADDRESS = re.compile(r"[a-z]+:")
_FENCE = re.compile(r"(^```.*?^```$)", re.MULTILINE | re.DOTALL)


def linked(text: str, written: str) -> list[str]:
    """Return the repository files linked from the Markdown of the file ``written``."""
    links = [link for part in _FENCE.split(text)[::2] for link, _ in _LINK.findall(part)]
    return [link_target(link, written) for link in links if not _ADDRESS.match(link)]


def link_target(link: str, written: str) -> str:
    """Return the repository file of a relative link in the file ``written``."""
    return posixpath.normpath(posixpath.join(posixpath.dirname(written), link))


def with_site_links(text: str, written: str) -> str:
    """Return the Markdown of the file ``written``, with links to the places on the site."""
    folder = posixpath.dirname(on_site(written)) or "."

    def relink(match: re.Match[str]) -> str:
        if _ADDRESS.match(match[1]):
            return match[0]
        return f"]({posixpath.relpath(on_site(link_target(match[1], written)), folder)}{match[2] or ''})"

    parts = _FENCE.split(text)
    parts[::2] = [_LINK.sub(relink, part) for part in parts[::2]]
    return "".join(parts)


def on_site(path: str) -> str:
    """Return the place of a repository file on the site."""
    path = FOLDERS.get(path, path)
    if path.startswith("docs/"):
        return re.sub(r"(^|/)README\.md$", r"\1index.md", path.removeprefix("docs/"))
    return OUTSIDE.get(path, f"project/files/{path}{'' if posixpath.splitext(path)[1] else '.txt'}")


def copy_pages(folder: Path) -> None:
    """Copy every page, picture and linked file to its place on the site."""
    left = [path.relative_to(ROOT).as_posix() for path in (ROOT / "docs").rglob("*") if path.is_file()]
    left += OUTSIDE
    for written in left:  # extended by linked files
        place = folder / on_site(written)
        place.parent.mkdir(parents=True, exist_ok=True)
        if written.endswith(".md"):
            text = (ROOT / written).read_text(encoding="utf-8")
            place.write_text(with_site_links(text, written), encoding="utf-8")
            left += [path for path in linked(text, written) if path not in left and (ROOT / path).is_file()]
        else:
            shutil.copyfile(ROOT / written, place)
    shutil.copyfile(ROOT / "tools" / "site.css", folder / "site.css")
    rows = [f"- [{heading(folder / page)}]({Path(page).name})" for page in decisions()]
    index = "\n".join(["# Decisions", "", *rows, ""])
    (folder / "decisions" / "index.md").write_text(index, encoding="utf-8")


def heading(page: Path) -> str:
    return page.read_text(encoding="utf-8").partition("\n")[0].removeprefix("# ")


def decisions() -> list[str]:
    return sorted(f"decisions/{path.name}" for path in (ROOT / "docs" / "decisions").glob("*.md"))


def navigation() -> list[object]:
    """Return tabs and their pages, in the order of the start page."""
    start = (ROOT / "docs" / "README.md").read_text(encoding="utf-8")
    named = [link for link, _ in _LINK.findall(start) if link.endswith(".md")]
    named = list(dict.fromkeys(named))
    tabs = [
        {title: [page for page in named if page.startswith(f"{folder}/")]} for folder, title in TABS.items()
    ]
    about = ["state.md", *OUTSIDE.values(), {"Decisions": ["decisions/index.md", *decisions()]}]
    return [{"Start": "index.md"}, *tabs, {"Project": about}]


def make_site(into: Path) -> None:
    """Write the site to a folder; raises `subprocess.CalledProcessError` for a broken link.

    It takes the place of an earlier one when it is complete: a server may be reading that one.
    """
    into.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=f".{into.name}-", dir=into.parent) as folder:
        complete = Path(folder) / "complete"
        build_site(complete)
        if into.exists():
            into.rename(Path(folder) / "earlier")
        complete.rename(into)


def build_site(into: Path) -> None:
    """Build the site in a folder that nobody reads yet."""
    with tempfile.TemporaryDirectory(prefix="rigctl-site-") as folder:
        pages, config = Path(folder) / "docs", Path(folder) / "mkdocs.yml"
        copy_pages(pages)
        added = {"docs_dir": str(pages), "site_dir": str(into), "nav": navigation()}
        rows = [f"{name}: {json.dumps(value)}\n" for name, value in added.items()]  # JSON is valid YAML
        settings = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
        config.write_text(settings + "".join(rows), encoding="utf-8")
        build = [sys.executable, "-m", "mkdocs", "build", "--quiet", "--strict", "--config-file", str(config)]
        subprocess.run(build, env={**os.environ, "NO_MKDOCS_2_WARNING": "1"}, check=True)
    for unused in (*into.rglob("*.map"), *into.glob("sitemap.*"), *into.rglob("lunr/*")):
        if unused.is_file():  # for other builders' debuggers, search engines and languages
            unused.unlink()


def main() -> int:
    """Write the site; return 1 for a broken link, which the builder reports."""
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--into", type=Path, default=ROOT / "build" / "site", help="the folder of the site")
    try:
        make_site(asked.parse_args().into.resolve())
    except subprocess.CalledProcessError:
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
