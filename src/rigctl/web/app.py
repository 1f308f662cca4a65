"""The application: the frame page, its parts, and their common routes."""

from __future__ import annotations

import asyncio
from collections.abc import Collection
from contextlib import ExitStack, asynccontextmanager
from functools import lru_cache
from html import escape
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from string import Template
from typing import TYPE_CHECKING, Any, Final

from starlette.applications import Starlette
from starlette.requests import ClientDisconnect, Request
from starlette.responses import HTMLResponse, RedirectResponse, Response
from starlette.routing import BaseRoute, Mount, Route
from starlette.staticfiles import StaticFiles

from rigctl.errors import RigctlError
from rigctl.web.access_control import SESSION_PATH, App, Gate, Keys, set_cookie
from rigctl.web.new_project import fill, is_empty
from rigctl.web.parts import PARTS
from rigctl.web.request_handling import delete, get, post, read_fields, refusal_text
from rigctl.web.request_timeout import PATIENCE
from rigctl.web.server_state import PagePart, Site

if TYPE_CHECKING:
    from collections.abc import AsyncIterator

_ASSETS: Final = Path(__file__).parent / "assets"
_REPORT_ASSETS: Final = Path(__file__).parents[1] / "report" / "assets"
#: most bytes of a request that only carries the token
_MOST_TOKEN: Final = 1000


def application(site: Site, keys: Keys, hosts: Collection[str], *, secure: bool) -> App:
    """Everything that is served, behind its gate."""

    @asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        yield
        with ExitStack() as ending:  # each is called, also after one that fails
            for end in (site.jobs.close, *reversed(site.at_end)):
                ending.callback(end)

    routes: list[BaseRoute] = [
        Route("/", lambda _: RedirectResponse(f"/{PARTS[0].name}")),
        Route(SESSION_PATH, _session(keys), methods=["POST"]),
        get("/api/status", lambda _: status(site)),
        post("/api/project", lambda request: fill(site, request)),
        get("/api/jobs", lambda _: {"jobs": [job.document() for job in site.jobs.all()]}),
        get("/api/jobs/{id}", lambda request: site.jobs.find(request.text("id")).document()),
        delete("/api/jobs/{id}", lambda request: site.jobs.stop(request.text("id")).document()),
        Route("/assets/page.css", _shared_style),
        Mount("/assets", StaticFiles(directory=_ASSETS)),
        *(Route(f"/{part.name}", _page(part)) for part in PARTS),
        *(route for part in PARTS for route in part.routes(site)),
    ]
    inner = Starlette(routes=routes, lifespan=lifespan, exception_handlers={404: _not_found})
    pages = {"/", *(f"/{part.name}" for part in PARTS)}
    return Gate(inner, keys=keys, hosts=hosts, secure=secure, open_paths=pages)


def status(site: Site) -> dict[str, Any]:
    """The state of the project and of the server's jobs, for every page."""
    site.refresh()
    root = site.project.root
    working = [job.document() for job in site.jobs.all() if job.state == "working"]
    return {
        "project": root.name,
        "root": str(root),
        "runs": str(site.project.runs),
        "there": root.is_dir(),
        "empty": is_empty(site),
        "version": installed_version(),
        "working": working,
    }


def installed_version() -> str:
    """Version of rigctl."""
    try:
        return version("rigctl")
    except PackageNotFoundError:
        return "unknown"


def _session(keys: Keys) -> Any:
    async def endpoint(request: Request) -> Response:
        try:
            async with asyncio.timeout(PATIENCE):  # a client without a session may not hold a connection
                token = (await read_fields(request, _MOST_TOKEN)).get("token")
        except (RigctlError, TimeoutError, ClientDisconnect):
            token = None
        session = keys.exchange(token) if isinstance(token, str) else None
        if session is None:
            text = "this is not the address that the server has printed; it changes with every start"
            closing = {"connection": "close"}  # the rest of its body is not waited for
            return Response(refusal_text(text), 401, closing, media_type="application/json")
        return Response(status_code=204, headers={"set-cookie": set_cookie(request.scope, session)})

    return endpoint


async def _shared_style(_: Request) -> Response:
    """The style sheet of the report, which defines colours and fonts of all pages of rigctl."""
    return Response((_REPORT_ASSETS / "page.css").read_bytes(), media_type="text/css")


async def _not_found(_: Request, __: Exception) -> Response:
    return Response(refusal_text("there is nothing at this address"), 404, media_type="application/json")


def _page(part: PagePart) -> Any:
    async def endpoint(_: Request) -> Response:
        return HTMLResponse(shell(part))

    return endpoint


def shell(part: PagePart) -> str:
    """The frame page of a part; it contains no data of the project, which its script requests."""
    links = "\n".join(_link(each, current=each is part) for each in PARTS)
    return _template().substitute(
        title=escape(part.title), name=escape(part.name), about=escape(part.about), links=links
    )


def _link(part: PagePart, *, current: bool) -> str:
    mark = ' aria-current="page"' if current else ""
    return f'<li><a href="/{escape(part.name)}"{mark}>{escape(part.title)}</a></li>'


@lru_cache(maxsize=1)
def _template() -> Template:
    return Template((_ASSETS / "shell.html").read_text(encoding="utf-8"))
