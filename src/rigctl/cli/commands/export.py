"""`rigctl export`: a run's data as a file for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rigctl.cli.echo import echo, print_json
from rigctl.cli.options.as_json import Json
from rigctl.wording import number_of

#: forms of an exported run besides tables
_FORMS = ("junit", "ro-crate")


def export(
    runs: Annotated[
        list[str],
        typer.Argument(
            metavar="RUN...", help="Id, start of an id, path, or 'latest'; several with --to ro-crate."
        ),
    ],
    *,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            help="File to write: .csv, .parquet, .tdms, .mf4, .mat or .xlsx; by default RUN.csv.",
        ),
    ] = None,
    table: Annotated[
        str | None,
        typer.Option(
            help="Table to write: samples, observations (condition and measures of each record), "
            "records or events."
        ),
    ] = None,
    record: Annotated[
        list[int] | None, typer.Option(help="Only the samples of this record; repeatable.")
    ] = None,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", "--force", help="Replace an existing file, but never one of a run.")
    ] = False,
    disarm: Annotated[
        bool, typer.Option("--disarm", help="In CSV: keep spreadsheets from interpreting texts as formulas.")
    ] = False,
    to: Annotated[
        str | None,
        typer.Option(
            metavar="FORM",
            help="junit: measures with their limits as test cases (.xml); ro-crate: complete runs "
            "for publication, a folder or .zip.",
        ),
    ] = None,
    licence: Annotated[
        str | None,
        typer.Option(
            "--licence", "--license", help="Licence of a crate: SPDX identifier or address, e.g. CC-BY-4.0."
        ),
    ] = None,
    title: Annotated[str | None, typer.Option(help="Title of a crate.")] = None,
    as_json: Json = False,
) -> None:
    """Write a run's data to a file that other programs read, every column with its unit.

    The extension determines the format: CSV, Parquet, TDMS (LabVIEW), MDF4, MAT (MATLAB) or XLSX; in the
    last four each record is a separate group or sheet. 'rigctl import' reads samples and observations back.
    By default --table is samples, or observations for a run without samples.

    With --to junit, or the extension .xml, the measures are written with their limits as JUnit XML, for
    build servers and test managers: one case for each measure, and one for the completion of the run.

    With --to ro-crate, one or more runs are written as a Research Object Crate 1.2: all their files,
    procedure and rig file, with operator, date, bench, device, units and licence.

    Example: rigctl export latest -o strokes.csv
    """
    from rigctl.dataset import open_run
    from rigctl.dataset.exporting import default_table, export_junit, export_ro_crate, export_run

    form = _form(to, output)
    if form == "ro-crate":
        opened_all = {run.id: run for run in map(open_run, runs)}
        path = output or Path(f"{list(opened_all)[-1]}-crate")
        files = export_ro_crate(tuple(opened_all.values()), path, licence=licence, title=title)
        if as_json:
            facts = {"runs": list(opened_all), "path": path.as_posix(), "form": form, "files": files}
            print_json(facts)
        else:
            runs_text = number_of(len(opened_all), "run")
            echo(f"{path.as_posix()}: {runs_text}, {files} files")
        return
    opened = open_run(_only(runs, licence, title))
    if form == "junit":
        path = output or Path(f"{opened.id}.xml")
        cases = export_junit(opened, path, overwrite=overwrite)
        if as_json:
            print_json({"run": opened.id, "path": path.as_posix(), "form": form, "cases": cases})
        else:
            echo(f"{path.as_posix()}: {cases} test cases")
        return
    table = table or default_table(opened)
    suffix = f"-{table}" if table != "samples" else ""
    path = output or Path(f"{opened.id}{suffix}.csv")
    exported = export_run(opened, path, table=table, records=record, overwrite=overwrite, disarm=disarm)
    if as_json:
        facts = {"run": opened.id, "path": path.as_posix(), "table": table}
        print_json({**facts, "rows": exported.rows, "disarmed": exported.disarmed})
    else:
        also = f"; {exported.disarmed} cells were disarmed with an apostrophe" if exported.disarmed else ""
        echo(f"{path.as_posix()}: {exported.rows} rows{also}")


def _form(to: str | None, output: Path | None) -> str | None:
    """The form besides tables: as named, or by the extension of the file."""
    from rigctl.errors import unknown_name

    if to is not None and to not in _FORMS:
        raise unknown_name("form", to, _FORMS)
    if to is None and output is not None and output.suffix.lower() == ".xml":
        return "junit"
    return to


def _only(runs: list[str], licence: str | None, title: str | None) -> str:
    """The only run, for a form that holds one run and no licence."""
    from rigctl.errors import RigctlError

    if licence is not None or title is not None:
        name = "--licence" if licence is not None else "--title"
        raise RigctlError(f"only a crate has '{name}'", expected="--to ro-crate")
    if len(runs) > 1:
        raise RigctlError(
            "several runs in one file", value=" ".join(runs), expected="one run, or --to ro-crate"
        )
    return runs[0]
