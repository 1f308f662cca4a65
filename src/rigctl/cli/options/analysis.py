"""Options of the commands that analyse runs with a model."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

Runs = Annotated[
    list[str],
    typer.Argument(metavar="RUN...", help="Ids, starts of ids, paths, or 'latest'.", show_default=False),
]
AsPage = Annotated[
    Path | None,
    typer.Option("--page", metavar="PAGE", help="Also write it as one HTML page.", show_default=False),
]
OneModel = Annotated[
    Path,
    typer.Option("--model", "-m", metavar="M", help="Model file; M@3 is its version 3.", show_default=False),
]


def check_condition(written: str | None) -> str | None:
    """Refuse what is no expression before anything is read; its names are those of the records."""
    if written is not None and written.strip():
        from rigctl.expressions import parse

        parse(written)
    return written


def _assumptions(written: list[str] | None) -> list[str] | None:
    """Refuse what is no assignment before anything is read."""
    from rigctl.dataset.assumptions import read_assumptions

    read_assumptions(written or ())
    return written


HoldOut = Annotated[
    str | None,
    typer.Option(
        "--hold-out",
        metavar="EXPR",
        callback=check_condition,
        help="Records to hold out of every fit, for evaluation only: 'oil == 60 degC', or by "
        "number, counted from 1: 'record > 20'.",
        show_default=False,
    ),
]
Only = Annotated[
    str | None,
    typer.Option(
        "--only",
        metavar="EXPR",
        callback=check_condition,
        help="Records to analyse, e.g. 'heater_1 > 0 %'; the noise is estimated from all records.",
        show_default=False,
    ),
]
Assume = Annotated[
    list[str] | None,
    typer.Option(
        "--assume",
        metavar="NAME=VALUE",
        callback=_assumptions,
        help="Value of an input or actuator that the runs did not record, e.g. 'heater=0'; "
        "repeatable. Otherwise it is estimated for each record.",
        show_default=False,
    ),
]
Page = Annotated[
    Path | None,
    typer.Option(
        "--output", "-o", metavar="PAGE", help="Also write it as one HTML page.", show_default=False
    ),
]
Force = Annotated[
    bool,
    typer.Option(
        "--force", help="Let -o replace a file that is not a page of rigctl, but never one of a run."
    ),
]
Fit = Annotated[
    bool,
    typer.Option("--fit/--no-fit", help="Fit the model's free parameters first; its file is not changed."),
]
