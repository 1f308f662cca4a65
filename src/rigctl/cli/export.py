"""`rigctl export`: a run's data as a file for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def export(
    run: Annotated[str, typer.Argument(metavar="RUN", help="Id, start of an id, path, or 'latest'.")],
    *,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="FILE", help="Ends in .csv or .parquet; RUN.csv by default."),
    ] = None,
    table: Annotated[str, typer.Option(help="samples, records or events.")] = "samples",
    record: Annotated[
        list[int] | None, typer.Option(help="Only the samples of this record; repeatable.")
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace a file that is there.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON document on stdout.")] = False,
) -> None:
    """Write a run's data to a file that any program reads, with units in its heading.

    'rigctl import' reads it back.

    Example: rigctl export latest -o strokes.csv
    """
    from rigctl.dataset import open_run
    from rigctl.dataset.exporting import export_run
    from rigctl.files.write import to_json

    opened = open_run(run)
    suffix = "" if table == "samples" else f"-{table}"
    path = output or Path(f"{opened.id}{suffix}.csv")
    rows = export_run(opened, path, table=table, records=record, overwrite=overwrite)
    if as_json:
        typer.echo(to_json({"run": opened.id, "path": str(path), "table": table, "rows": rows}))
    else:
        typer.echo(f"{path}: {rows} rows")
