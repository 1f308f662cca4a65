"""`rigctl export`: a run's data as a file for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rigctl.cli.echo import echo, echo_json


def export(
    run: Annotated[str, typer.Argument(metavar="RUN", help="Id, start of an id, path, or 'latest'.")],
    *,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            help="Ends in .csv, .parquet, .tdms, .mf4, .mat or .xlsx; RUN.csv by default.",
        ),
    ] = None,
    table: Annotated[
        str | None,
        typer.Option(help="samples; observations: condition and measures of each record; records; events."),
    ] = None,
    record: Annotated[
        list[int] | None, typer.Option(help="Only the samples of this record; repeatable.")
    ] = None,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", "--force", help="Replace a file that is there; never one of a run.")
    ] = False,
    disarm: Annotated[
        bool, typer.Option("--disarm", help="In CSV: keep a spreadsheet from taking texts for formulas.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON document on stdout.")] = False,
) -> None:
    """Write a run's data to a file that other programs read, every column with its unit.

    The end of the file's name says its kind: CSV, Parquet, TDMS (LabVIEW), MDF4, MAT (MATLAB) or XLSX; in the
    last four each record is a group, or a sheet, of its own. 'rigctl import' reads samples and observations
    back. Without --table it is the samples, or the observations of a run that has no samples.

    Example: rigctl export latest -o strokes.csv
    """
    from rigctl.dataset import open_run
    from rigctl.dataset.exporting import default_table, export_run
    from rigctl.files.write import to_json

    opened = open_run(run)
    table = table or default_table(opened)
    suffix = f"-{table}" if table != "samples" else ""
    path = output or Path(f"{opened.id}{suffix}.csv")
    exported = export_run(opened, path, table=table, records=record, overwrite=overwrite, disarm=disarm)
    if as_json:
        facts = {"run": opened.id, "path": str(path), "table": table}
        echo_json(to_json({**facts, "rows": exported.rows, "disarmed": exported.disarmed}))
    else:
        also = f"; {exported.disarmed} cells were disarmed with an apostrophe" if exported.disarmed else ""
        echo(f"{path}: {exported.rows} rows{also}")
