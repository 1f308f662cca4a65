"""`--no-cache` and `--verbose` of the commands that fit: control and report the reuse of earlier results."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Annotated

import typer

from rigctl.printable import shown_path

if TYPE_CHECKING:
    from rigctl.engine.result_cache.cached import Tally


def _without(context: typer.Context, wanted: bool) -> bool:
    """Neither use nor store cached results until the command ends."""
    if wanted and not context.resilient_parsing:
        from rigctl.engine.result_cache import switched_off

        context.with_resource(switched_off())
    return wanted


def _say_at_end(context: typer.Context, wanted: bool) -> bool:
    if wanted and not context.resilient_parsing:
        from dataclasses import replace

        from rigctl.engine.result_cache import TALLY

        context.call_on_close(partial(_say, replace(TALLY)))
    return wanted


def _say(before: Tally) -> None:
    from rigctl.cli.echo import echo
    from rigctl.engine.result_cache import RESULTS_VARIABLE, TALLY, results_folder

    folder = results_folder()
    summary = f"made and kept: {TALLY.made - before.made}, in {shown_path(folder)}"
    where = f"none kept, as {RESULTS_VARIABLE} is 'off'" if folder is None else summary
    echo(f"Results of earlier commands reused: {TALLY.reused - before.reused}; {where}", err=True)


#: of every command that fits
NoCache = Annotated[
    bool,
    typer.Option(
        "--no-cache",
        callback=_without,
        help="Compute everything again: do not reuse fits of earlier commands or store new ones.",
    ),
]
Verbose = Annotated[
    bool,
    typer.Option(
        "--verbose",
        "-v",
        callback=_say_at_end,
        help="Report on stderr how many results of earlier commands were reused.",
    ),
]
#: of those that print an answer first
Evidence = Annotated[
    bool,
    typer.Option(
        "--verbose",
        "-v",
        callback=_say_at_end,
        help="Also show the evidence, and report on stderr how many results of earlier commands were reused.",
    ),
]
