"""`rigctl serve`: the project in a browser."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from rigctl.cli.echo import echo
from rigctl.errors import RigctlError, unknown_name

#: copied from `rigctl.web.parts`, which needs optional packages
PAGES = ("runs", "live", "workbench", "procedure", "report", "docs")


def serve(
    project: Annotated[
        Path | None, typer.Argument(help="Project folder; by default that of the current folder.")
    ] = None,
    port: Annotated[
        int | None, typer.Option(min=0, max=65535, help="Port to serve on; 0 for any free one.")
    ] = None,
    host: Annotated[
        str, typer.Option(help="Address to serve on; one that other computers can reach needs TLS.")
    ] = "127.0.0.1",
    certificate: Annotated[Path | None, typer.Option(help="TLS certificate, a PEM file.")] = None,
    key: Annotated[Path | None, typer.Option(help="Key of the certificate, a PEM file.")] = None,
    name: Annotated[
        list[str] | None, typer.Option(help="Further host name under which browsers reach it; repeatable.")
    ] = None,
    *,
    expose: Annotated[
        bool, typer.Option("--expose", help="Allow access from other computers, and so access to the bench.")
    ] = False,
    no_browser: Annotated[bool, typer.Option("--no-browser", help="Print the address only.")] = False,
    page: Annotated[str, typer.Option(help="Page to open: runs, live, workbench, procedure …")] = "",
    until_input_ends: Annotated[bool, typer.Option("--until-input-ends", hidden=True)] = False,
) -> None:
    """Show the project in a browser: runs, the run in progress, models, procedures, reports.

    By default only this computer can reach it, and only with the address that is printed: the part after #
    is a key. Ctrl-C ends it; a run in progress continues.

    Examples:

      rigctl serve

      rigctl serve ~/benches/press --port 9000 --no-browser
    """
    from rigctl.project import find_project
    from rigctl.web.browser import can_open, open_browser
    from rigctl.web.server import Settings, serve

    if page and page not in PAGES:
        raise unknown_name("page", page, PAGES)
    if project is not None and not project.is_dir():
        raise RigctlError("there is no such folder", value=str(project))

    def started(address: str) -> None:
        base, _, token = address.partition("#")
        address = f"{base}{page}#{token}"
        echo(f"{target.root.name} is shown at\n  {address}\nCtrl-C ends it; a run in progress continues.")
        if not no_browser and can_open():
            open_browser(address)

    target = find_project(project)
    settings = Settings(
        target,
        host,
        port,
        certificate=_file(certificate),
        key=_file(key),
        exposed=expose,
        names=tuple(name or ()),
    )
    serve(settings, started, _input_ended() if until_input_ends else None)


def _input_ended() -> Callable[[], bool]:
    """Whether stdin is at its end: the parent process has ended, or requests the end of this one."""
    from rigctl.child_process import own_stdin

    ended, stdin = threading.Event(), own_stdin()

    def read() -> None:
        while os.read(stdin, 1):
            pass
        ended.set()

    threading.Thread(target=read, name="input", daemon=True).start()
    return ended.is_set


def _file(path: Path | None) -> Path | None:
    if path is not None and not path.is_file():
        raise RigctlError("there is no such file", value=path.as_posix())
    return path
