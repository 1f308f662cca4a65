"""`rigctl pause`, `continue` and `abort`: act on a run in progress from another terminal."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rigctl.cli.echo import echo, print_json
from rigctl.cli.options.as_json import Json
from rigctl.errors import ExitCode, RigctlError

if TYPE_CHECKING:
    from rigctl.runner.operators.requests import Request

Ref = Annotated[
    str | None,
    typer.Argument(metavar="[RUN]", help="Id, start of an id, or path; by default the run in progress."),
]


def pause(run: Ref = None, *, as_json: Json = False) -> None:
    """Pause a run: outputs go to the safe state, sampling and interlocks continue.

    A record in progress is completed first.

    Example: rigctl pause
    """
    from rigctl.runner.operators.requests import Request

    _ask(run, Request.PAUSE, as_json)


def continue_(run: Ref = None, *, as_json: Json = False) -> None:
    """Continue a paused run; the interrupted step starts again.

    Example: rigctl continue
    """
    from rigctl.runner.operators.requests import Request

    _ask(run, Request.CONTINUE, as_json)


def abort(run: Ref = None, *, as_json: Json = False) -> None:
    """End a run: outputs go to the safe state first, then its cleanup steps run and its data are closed.

    Example: rigctl abort
    """
    from rigctl.runner.operators.requests import Request

    _ask(run, Request.ABORT, as_json)


def _ask(run: str | None, request: Request, as_json: bool) -> None:
    from rigctl.dataset import find_run
    from rigctl.runner.operators.remote_control import send

    folder = find_run(run) if run is not None else _in_progress()
    answer = send(folder, request)
    if as_json:
        print_json({"run": folder.name, "answer": answer}, indent=None)
    else:
        echo(f"{folder.name}: {answer}")


def _in_progress() -> Path:
    """The one run that is in progress here.

    Raises
    ------
    RigctlError
        there is none, or more than one.
    """
    from rigctl.dataset.catalogue import newest_folders
    from rigctl.dataset.recording.writer_lock import in_progress

    folders = [folder for folder in newest_folders() if in_progress(folder)]
    if len(folders) == 1:
        return folders[0]
    raise RigctlError(
        "no run is in progress" if not folders else "more than one run is in progress",
        expected="one of " + ", ".join(folder.name for folder in folders) if folders else None,
        exit_code=ExitCode.FAILED,
    )
