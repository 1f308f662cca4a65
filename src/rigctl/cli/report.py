"""`rigctl report`: one page about one or more runs."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer


class FigureFormat(StrEnum):
    """Formats of figures."""

    PNG = "png"
    SVG = "svg"


def report(
    runs: Annotated[
        list[str], typer.Argument(metavar="RUN...", help="Ids, starts of ids, paths, or 'latest'.")
    ],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="The page; by default RUN.html in this folder.")
    ] = None,
    figures: Annotated[
        Path | None, typer.Option(help="A folder for every plot as a file of its own.")
    ] = None,
    form: Annotated[FigureFormat, typer.Option("--format", help="Of the figures.")] = FigureFormat.PNG,
    as_json: Annotated[bool, typer.Option("--json", help="Say what was written as JSON.")] = False,
) -> None:
    """Make one self-contained HTML page about one or more runs.

    The page holds its plots and data, needs no network, and can be sent by mail or printed.

    Examples:

      rigctl report latest

      rigctl report 20261121-0900 20261122-0900 -o both-days.html --figures figures --format svg
    """
    from rigctl.dataset import open_run
    from rigctl.files.write import to_json
    from rigctl.report import write_report

    opened = {run.id: run for run in map(open_run, runs)}  # a run that is named twice is one run
    first = next(iter(opened))
    more = len(opened) - 1
    target = output or Path(f"{first}-and-{more}-more.html" if more else f"{first}.html")
    written = write_report(list(opened.values()), target, figures=figures, form=form.value)
    if as_json:
        facts = {
            "page": written.page,
            "bytes": written.size,
            "figures": list(written.figures),
            "runs": list(written.runs),
        }
        typer.echo(to_json(facts))
    else:
        typer.echo(f"Wrote {written.summary()}")
