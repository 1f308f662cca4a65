"""`--serve`: show the project in a browser during a long command.

The page is served by a separate process, which reads the command's files, so that no viewer can delay the
command.
"""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import IO, Annotated

import typer

from rigctl.child_process import module_command
from rigctl.cli.echo import echo

ServeOption = Annotated[
    bool, typer.Option("--serve", help="Show the project in a browser during the run, see 'rigctl serve'.")
]


@contextmanager
def shown(*, wanted: bool) -> Iterator[None]:
    """Serve the project while a command works; at a terminal also afterwards, until Ctrl-C.

    If it cannot be served, because it already is or no port is free, that is reported and the command works
    all the same.
    """
    server = _begin() if wanted else None
    if server is None:
        yield
        return
    try:
        yield
    finally:
        with suppress(KeyboardInterrupt):
            if _at_a_terminal() and server.poll() is None:
                echo("The page stays until Ctrl-C.", err=True)
                server.wait()
        _end(server)


def _begin() -> subprocess.Popen[str] | None:
    from rigctl.project import find_project

    command = module_command("rigctl", "serve", str(find_project().root), "--page", "live")
    # Ctrl-C ends only the command, not the server: the end of a run can be watched too
    group = getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0)
    server = subprocess.Popen(  # noqa: S603 - this program, no shell
        [*command, "--until-input-ends"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        encoding="utf-8",
        creationflags=group,
        start_new_session=not group,
    )
    first_words = _first_words(server)
    if server.poll() is not None:
        echo(f"note: {first_words}", err=True)
        _end(server)
        return None
    echo(f"Shown at {first_words}", err=True)
    return server


def _first_words(server: subprocess.Popen[str]) -> str:
    """The address that a server prints, or the reason why there is none."""
    assert server.stdout is not None  # noqa: S101 - opened as a pipe
    lines: list[str] = []
    for line in server.stdout:
        if "#" in line and "://" in line:
            threading.Thread(target=_drain, args=(server.stdout,), name="server", daemon=True).start()
            return line.strip()
        lines.append(line.strip())
    server.wait()
    return " ".join(lines).removeprefix("rigctl: ")


def _drain(stream: IO[str]) -> None:
    with suppress(ValueError, OSError):
        for _ in stream:
            pass


def _end(server: subprocess.Popen[str]) -> None:
    """End the server by closing its stdin, which it monitors; it also ends if this program is killed."""
    with suppress(OSError):
        if server.stdin is not None:
            server.stdin.close()
    try:
        server.wait(10.0)
    except subprocess.TimeoutExpired:
        server.kill()
        server.wait()


def _at_a_terminal() -> bool:
    from rigctl.cli.attended_run import typing_possible

    return typing_possible() and sys.stdout.isatty()
