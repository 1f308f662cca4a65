"""The page of one or more runs, made by `rigctl report`, in a frame of this one."""

from __future__ import annotations

import html
import re
from collections.abc import Sequence
from pathlib import Path
from secrets import token_hex
from typing import TYPE_CHECKING, Any, Final

from starlette.responses import HTMLResponse, Response

from rigctl.command_line import command
from rigctl.errors import RigctlError
from rigctl.files.regular import read_text
from rigctl.web.project_files import plain_id, project_file, project_files
from rigctl.web.request_handling import PageRequest, get, post
from rigctl.web.server_state import PagePart, Site

if TYPE_CHECKING:
    from starlette.routing import BaseRoute

#: runs on one page
_MOST: Final = 20
_POLICY: Final = re.compile(r'http-equiv="Content-Security-Policy" content="([^"]*)"')


def routes(site: Site) -> Sequence[BaseRoute]:
    """The routes of the page."""
    pages = Pages(site)
    return (
        get("/api/report/models", pages.models),
        post("/api/report", pages.make),
        get("/report/made/{job}", pages.show),
    )


class Pages:
    """The reports made since the server was started."""

    def __init__(self, site: Site) -> None:
        self._site = site

    def models(self, request: PageRequest) -> dict[str, Any]:
        """The project's model files."""
        root = self._site.require_project()
        return {"models": project_files(root, "models")}

    def make(self, request: PageRequest) -> dict[str, Any]:
        """Start to make a page; it is shown under the id of the job."""
        root = self._site.require_project()
        runs = [plain_id(run) for run in request.texts("runs")]
        if not 0 < len(runs) <= _MOST:
            raise RigctlError("runs: how many is wrong", value=str(len(runs)), expected=f"1 to {_MOST}")
        arguments = [*runs]
        for model in request.texts("models"):
            arguments += ["--model", project_file(root, model).relative_to(root.resolve()).as_posix()]
        if request.body.get("diagnose") is True:
            arguments.append("--diagnose")
        page = self._site.jobs.scratch / f"{token_hex(8)}.html"  # two windows may ask at once
        page.touch(0o600)
        job = self._site.jobs.start_command("Report", ["report", *arguments, "-o", str(page), "--force"])
        job.command = command(["report", *arguments])
        return job.document()

    def show(self, request: PageRequest) -> Response:
        """A finished page, under its own policy and without this server's rights.

        It is sandboxed: its scripts do not run with the origin of this server, so that a flaw in it can reach
        neither the cookie nor a command.
        """
        import json

        job = self._site.jobs.find(request.text("job"))
        if job.result is None:
            raise RigctlError("the page is not made yet")
        file_name = json.loads(job.result).get("page")
        page = Path(str(file_name)).resolve()
        if not page.is_relative_to(self._site.jobs.scratch.resolve()):
            raise RigctlError("this work has made no page")
        text = read_text(page)
        match = _POLICY.search(text)
        policy = html.unescape(match.group(1)) if match else "default-src 'none'"
        sealed = f"{policy}; frame-ancestors 'self'; sandbox allow-scripts allow-downloads allow-popups"
        return HTMLResponse(text, headers={"content-security-policy": sealed})


PART = PagePart("report", "Report", "What one or more runs have shown.", routes)
