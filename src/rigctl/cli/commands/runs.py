"""`rigctl runs`: the catalogue of runs.

In: ids, or a condition. Out: lists, one run in full, verified checksums, notes, copies in storage, or the
answer to a query. What is found, and how, is in `rigctl.dataset`; here it becomes tables or JSON. A run
in storage is shown from there; only those of this computer can be annotated.

Two dialects of SQL meet here. A condition (`--where`) is SQLite's, answered by the index, so that finding
a few among many runs opens none of them; a query (`sql`) is DuckDB's, which reads the Parquet files. Both
see the same columns. Texts in the tables come from people and devices: they are printed as text, never as
markup or control characters.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from datetime import datetime, timedelta
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rigctl.cli.echo import echo, print_json
from rigctl.cli.options.as_json import Json
from rigctl.errors import ExitCode, RigctlError
from rigctl.printable import printable
from rigctl.units import significant
from rigctl.wording import noun

if TYPE_CHECKING:
    from pathlib import Path

    from rich.table import Table

    from rigctl.dataset import RunSummary
    from rigctl.dataset.storage import StoredFolder

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    help="List, show, verify, annotate, exclude and query runs.\n\n"
    "A RUN is given by its id, an unambiguous start of it, its path, or 'latest'.",
)

Where = Annotated[
    str | None,
    typer.Option(
        metavar="CONDITION",
        help='Only runs that meet this SQL condition: "records > 20".',
        show_default=False,
    ),
]
#: runs in a row for which a storage does not answer, after which no more are sent
_SILENT_RUNS = 2
#: the state of a run whose outputs may still be on
_UNCONFIRMED = "OUTPUTS NOT CONFIRMED SAFE"
#: rows of a query that a terminal shows
_SHOWN_ROWS = 1000
#: default number of listed runs
SHOWN = 100
Ref = Annotated[str, typer.Argument(metavar="RUN", help="Id, start of an id, path, or 'latest'.")]


@app.command("list")
def list_(
    *,
    where: Where = None,
    last: Annotated[
        int | None, typer.Option(min=1, help=f"Only this many of the newest runs; by default {SHOWN}.")
    ] = None,
    every: Annotated[bool, typer.Option("--all", help="List all runs.")] = False,
    as_json: Json = False,
) -> None:
    """List runs, oldest first.

    Example: rigctl runs list --where "rig = 'HL-32 test bench' AND started >= '2026-11'"
    """
    from rigctl.dataset import list_runs

    # A terminal gets the newest runs unless asked for more, a program all unless asked for fewer.
    if last and every:
        raise RigctlError("'--last' and '--all' exclude each other")
    most = None if every or (as_json and not last) else last or SHOWN
    # one more than shown, to know whether there are more
    wanted = most + 1 if most and not last else most
    # If the storage does not answer, the local runs are listed with a note. A wrong condition fails there
    # as well, and gives its own error.
    try:
        listing = list_runs(where=where, last=wanted)
    except RigctlError as problem:
        listing = list_runs(where=where, last=wanted, stored=False)  # repeats a condition's error
        echo(f"note: {problem}. Only the runs of this computer are listed", err=True)
    shown = listing[-most:] if most else listing
    if as_json:
        print_json({"runs": [vars(run) for run in shown]}, indent=1)  # asdict() would make deep copies
    elif not shown:
        none = (
            "No run meets the condition."
            if where
            else "There are no runs yet; 'rigctl simulate PROCEDURE' makes one."
        )
        echo(none)
    else:
        if len(listing) > len(shown):
            echo(f"The newest {len(shown)}; '--all' lists every one, '--where' chooses.", err=True)
        _print_table(_runs_table(shown))


@app.command()
def show(run: Ref = "latest", *, as_json: Json = False) -> None:
    """Show one run: procedure, device, operator and records.

    Example: rigctl runs show latest
    """
    from pathlib import Path

    from rigctl.dataset.catalogue import locate_run, status_of
    from rigctl.dataset.run_json import read_info

    folder = locate_run(run)
    if isinstance(folder, Path):
        info = {**read_info(folder), "folder": folder}
        info["status"] = status_of(folder, info)
    else:
        info = {**folder.info, "folder": folder}
    # A run that is not closed has no tables yet.
    open_still = info["status"] in ("running", "unclosed")
    records, facts = ([], {}) if open_still else _records(folder)
    if as_json:
        units = {name: fact["unit"] for name, fact in facts.items() if fact.get("unit")}
        print_json({**info, "records": records, "record_units": units}, indent=1)
        return
    _print_table(_facts_table(info))
    if records:
        _print_table(_records_table(records, facts))
    for annotation in info.get("annotations", ()):
        about = "" if annotation["record"] is None else f" (record {annotation['record']})"
        echo(
            f"{_instant(annotation['when'])} {annotation['by']}: "
            f"{annotation['kind']}{about}: {annotation['text']}"
        )


@app.command()
def verify(
    runs: Annotated[list[str] | None, typer.Argument(metavar="RUN", help="Runs; by default all.")] = None,
    *,
    as_json: Json = False,
) -> None:
    """Verify runs by their checksums, and recover those that were never closed.

    A run in progress is left alone. Ends with exit code 1 when a run is broken.

    Example: rigctl runs verify latest
    """
    from pathlib import Path

    from rigctl import dataset
    from rigctl.dataset.catalogue import locate_run, run_folders, runs_folder
    from rigctl.dataset.storage.verify import verify_stored

    # Those in storage are verified in place, by the checksums in their `run.json`; local ones that were
    # never closed are recovered.
    folders = [locate_run(ref) for ref in runs] if runs else run_folders(runs_folder())
    verdicts = [
        dataset.verify(folder) if isinstance(folder, Path) else verify_stored(folder) for folder in folders
    ]
    broken = sum(not verdict.good for verdict in verdicts)
    if as_json:
        documents = [
            {"run": verdict.id, "condition": verdict.condition.value, "problems": list(verdict.problems)}
            for verdict in verdicts
        ]
        print_json({"runs": documents, "broken": broken}, indent=1)
    else:
        for verdict in verdicts:
            echo(f"{verdict.id}: {verdict.condition.value}")
            for problem in verdict.problems:
                echo(f"  {problem}")
        if not verdicts:
            echo("There are no runs yet.")
    if broken:
        raise typer.Exit(ExitCode.FAILED)


@app.command()
def upload(
    runs: Annotated[list[str] | None, typer.Argument(metavar="RUN", help="Runs; by default all.")] = None,
    *,
    to: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="Address of the storage, instead of that in rigctl.toml.",
            show_default=False,
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Send closed runs to storage, such as s3://bucket/runs; files already there are not sent again.

    Every file is read back and compared by its checksum. The local runs are kept. Ends with exit code 1 when
    a run could not be sent.

    Example: rigctl runs upload --to s3://lab/runs
    """
    from rigctl.dataset import find_run
    from rigctl.dataset.catalogue import run_folders, runs_folder
    from rigctl.dataset.storage import Store
    from rigctl.dataset.storage import upload as send
    from rigctl.dataset.storage.store import StorageSilent
    from rigctl.project import find_project

    address = to or find_project().store
    if address is None:
        raise RigctlError("no storage is named", expected='--to ADDRESS, or runs = "s3://…" in rigctl.toml')
    folders = [find_run(ref) for ref in runs] if runs else run_folders(runs_folder())
    store, outcomes = Store(address), []
    silent = 0  # runs in a row for which the storage did not answer: each takes up to minutes
    # One run after the other, and one that fails does not stop the rest, unless the storage is silent.
    for folder in folders:
        try:
            if silent == _SILENT_RUNS:
                raise StorageSilent("not tried, because the storage does not respond")
            done = send(folder, store)
        except StorageSilent as problem:
            silent = min(silent + 1, _SILENT_RUNS)
            outcomes.append({"run": folder.name, "sent": 0, "there": 0, "problem": str(problem)})
        except RigctlError as problem:
            outcomes.append({"run": folder.name, "sent": 0, "there": 0, "problem": str(problem)})
        else:
            silent = 0
            outcomes.append({"run": done.run, "sent": done.sent, "there": done.there, "problem": None})
        if not as_json:
            last = outcomes[-1]
            outcome = last["problem"] or f"{last['sent']} files sent, {last['there']} were already there"
            echo(f"{folder.name}: {outcome}")
    if as_json:
        print_json({"address": address, "runs": outcomes}, indent=1)
    if any(one["problem"] for one in outcomes):
        raise typer.Exit(ExitCode.FAILED)


@app.command()
def annotate(
    run: Ref,
    text: Annotated[str, typer.Argument(help="Text of the note.")],
    *,
    record: Annotated[int | None, typer.Option(help="Record to annotate; by default the run.")] = None,
    as_json: Json = False,
) -> None:
    """Add a note to a run or to one of its records.

    Example: rigctl runs annotate latest "new piston seals" --record 3
    """
    from rigctl import dataset

    folder = dataset.find_run(run)
    dataset.annotate(folder, text, record=record)
    _confirm({"run": folder.name, "record": record, "note": text}, f"{folder.name}: noted", as_json=as_json)


@app.command()
def exclude(
    run: Ref,
    records: Annotated[list[int], typer.Argument(metavar="RECORD...", help="Indices, from 0.")],
    *,
    reason: Annotated[str, typer.Option(help="Reason; kept with the record.")],
    undo: Annotated[bool, typer.Option("--undo", help="Include them in analysis again.")] = False,
    as_json: Json = False,
) -> None:
    """Exclude records from analysis, with a reason; they are never deleted.

    Example: rigctl runs exclude latest 3 4 --reason "air in the oil"
    """
    from rigctl import dataset

    folder = dataset.find_run(run)
    (dataset.include if undo else dataset.exclude)(folder, records, reason)
    listed = ", ".join(map(str, records))
    done = "included again" if undo else "excluded from analysis"
    facts = {"run": folder.name, "records": records, "excluded": not undo, "reason": reason}
    _confirm(facts, f"{folder.name}: record {listed} {done}", as_json=as_json)


@app.command()
def sql(
    query: Annotated[str, typer.Argument(metavar="SELECT", help="One SELECT in DuckDB's dialect.")],
    *,
    where: Where = None,
    as_json: Json = False,
) -> None:
    """Query all closed runs: tables runs, records, samples, events and units.

    The query can read only the data of the runs, with --where only of those that meet it, and cannot write.

    Example: rigctl runs sql "SELECT oil, supply, avg(stroke) FROM records GROUP BY ALL ORDER BY ALL"
    """
    from rigctl import dataset

    answer = dataset.query(query, where=where)
    if as_json:
        rows = [[_plain_cell(value) for value in row] for row in answer.rows]
        print_json({"columns": list(answer.columns), "rows": rows}, indent=1)
    else:
        _print_rows(answer.columns, answer.rows)


def _print_rows(columns: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
    """Print the rows of a query: a terminal shows the first ones, a pipe gets all.

    All rows are aligned here, since a table with folded cells would take minutes.
    """
    if len(rows) <= _SHOWN_ROWS or sys.stdout.isatty():
        _print_table(_table(columns, [[_cell(value) for value in row] for row in rows[:_SHOWN_ROWS]]))
        if len(rows) > _SHOWN_ROWS:
            message = f"The first {_SHOWN_ROWS} of {len(rows)} rows are shown."
            echo(f"{message} Redirect the output, or use '--json', to get all.", err=True)
        return
    cells = ([_cell(value) for value in row] for row in rows)
    lines = [[printable(cell) for cell in row] for row in (columns, *cells)]
    widths = [max(map(len, cells)) for cells in zip(*lines, strict=True)]
    echo("\n".join(_laid_out(line, widths) for line in lines))


def _laid_out(cells: Sequence[str], widths: Sequence[int]) -> str:
    return "  ".join(cell.ljust(width) for cell, width in zip(cells, widths, strict=True)).rstrip()


def _runs_table(runs: Sequence[RunSummary]) -> Table:
    """One line for each; columns about a device under test only where a run has one."""
    columns: dict[str, Callable[[RunSummary], str]] = {
        "run": lambda run: run.id,
        "status": lambda run: f"{run.status}, {_UNCONFIRMED}" if run.unconfirmed else run.status,
        "test": lambda run: run.test if run.test != "none" else "",
        "procedure": lambda run: run.procedure,
        "serial number": lambda run: run.serial_number,
        "part": lambda run: run.part,
        "duration": lambda run: _duration(run.duration),
        "records": _records_cell,
        "samples": lambda run: _cell(run.rows),
        "notes": lambda run: _cell(run.notes or None),
    }
    if not any(run.test in ("pass", "fail") for run in runs):
        del columns["test"]
    for name in ("serial number", "part"):
        if not any(columns[name](run) for run in runs):
            del columns[name]
    return _table(tuple(columns), [[cell(run) for cell in columns.values()] for run in runs])


def _records_cell(run: RunSummary) -> str:
    """``27/28, 1 excluded``: complete ones of all."""
    if run.records is None:
        return ""
    complete = run.complete_records == run.records
    text = str(run.records) if complete else f"{run.complete_records}/{run.records}"
    return f"{text}, {run.excluded} excluded" if run.excluded else text


def _facts_table(info: Mapping[str, Any]) -> Table:
    """The summary of a run for people."""
    backend = ", ".join(f"{key} {value}" for key, value in info["backend"].items())
    reason = f": {info['reason']}" if info.get("reason") else ""
    from rigctl.dataset.history import absences_in

    doubt = info.get("unconfirmed")
    facts = {
        "attention": f"{_UNCONFIRMED}: {doubt} may still be on" if doubt else "",
        "run": info["id"],
        "status": f"{info['status']}{reason}",
        "procedure": _source(info["procedure"]),
        "rig": _source(info["rig"]),
        "bench": backend,
        "lost devices": absences_in(info),
        "test": _test(info.get("test", {})),
        "serial number": info.get("device", {}).get("serial_number"),
        "part": info.get("device", {}).get("part"),
        "operator": info["operator"],
        "notes": info.get("device", {}).get("notes"),
        "started": _instant(info["started"]),
        "duration": _duration(info.get("duration")),
        "clock": info["clock"],
        "seed": _cell(info["seed"]),
        "samples": _cell(info.get("rows")),
        "measures": ", ".join(
            f"{measure['name']} {_reading(measure['value'])} {measure['unit']}"
            for measure in info.get("measures", ())
        ),
        "folder": str(info["folder"]),
    }
    table = _table((), [[name, value] for name, value in facts.items() if value])
    table.show_header = False
    return table


def _test(test: Mapping[str, Any]) -> str:
    """``fail, 2 of 12 measures outside their limits``; nothing where no measure has limits."""
    result, passed, missed = test.get("result"), int(test.get("passed", 0)), int(test.get("missed", 0))
    if result in (None, "none") or not (passed or missed):
        return ""
    total = passed + missed
    measures, its = noun(total, "measure"), noun(total, "its", "their")
    if missed:
        return f"{result}, {missed} of {total} {measures} outside {its} limits"
    return f"{result}, {total} {measures} within {its} limits"


def _source(source: Mapping[str, str]) -> str:
    return f"{source['name']} ({source['path']})" if source["path"] else source["name"]


def _records(folder: Path | StoredFolder) -> tuple[list[dict[str, Any]], dict[str, dict[str, str]]]:
    """The rows of records.parquet, and the metadata of its columns."""
    from rigctl.dataset.recording import records_file
    from rigctl.dataset.table_columns import open_table

    with open_table(folder / records_file.RECORDS) as file:
        rows: list[dict[str, Any]] = file.read().to_pylist()
        facts = {
            field.name: {key.decode(): value.decode("utf-8") for key, value in (field.metadata or {}).items()}
            for field in file.schema_arrow
        }
    return rows, facts


def _records_table(records: Sequence[Mapping[str, Any]], facts: Mapping[str, Mapping[str, str]]) -> Table:
    """One line per record; a measure outside its limits is marked."""
    # Left out are what only programs need, and columns that would be empty in every record. The verdict on
    # a measure is shown in the cell of its value.
    hidden = {"path", "rate", "session"}
    if not any(record["excluded"] for record in records):
        hidden.add("excluded")
    if not any(record.get("missing") for record in records):
        hidden.add("missing")
    passed = {fact["variable"]: name for name, fact in facts.items() if fact.get("kind") == "passed"}
    names = [name for name in facts if name not in hidden and name not in passed.values()]
    units = {name: facts[name].get("unit", "") for name in names}
    heads = [f"{name} [{units[name]}]" if units[name] not in ("", "1") else name for name in names]

    def cell(record: Mapping[str, Any], name: str) -> str:
        verdict = passed.get(facts[name].get("variable", ""))
        missed = facts[name].get("kind") == "measure" and verdict and record[verdict] is False
        value = record[name]
        if facts[name].get("kind") in ("measure", "sweep"):
            return _reading(value) + (" missed" if missed else "")
        return f"{value:.2f}" if name in ("start", "end") and value is not None else _cell(value)

    return _table(heads, [[cell(record, name) for name in names] for record in records])


def _table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> Table:
    """A table of plain columns; users' texts are never interpreted as markup."""
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False)
    for index, column in enumerate(columns):
        table.add_column(Text(printable(column)), overflow="fold", no_wrap=index == 0)
    for row in rows:
        table.add_row(*(Text(printable(cell, keep="\n"), style=_style(cell)) for cell in row))
    return table


def _style(cell: str) -> str:
    """Red for an ending that somebody has to look at."""
    return "bold red" if _UNCONFIRMED in cell or cell == "fail" or cell.startswith("fail,") else ""


def _print_table(table: Table) -> None:
    from rigctl.cli.tables import console

    # a pipe has no width: nothing is folded there
    console(piped_width=4096).print(table)


def _confirm(facts: Mapping[str, Any], sentence: str, *, as_json: bool) -> None:
    if as_json:
        print_json(facts, indent=1)
    else:
        echo(sentence)


def _cell(value: object) -> str:
    if value is None:
        return ""
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _reading(value: object) -> str:
    """A measured value to four digits, the accuracy of a bench; '--json' has all."""
    return significant(value) if isinstance(value, float) else _cell(value)


def _instant(text: str) -> str:
    """``2026-11-21 05:50:06 UTC``: a time as it was written in ``run.json``, to the second."""
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        return text
    return f"{moment:%Y-%m-%d %H:%M:%S} {moment.tzname() or ''}".rstrip()


def _plain_cell(value: object) -> object:
    """A value of a query's result in a form for JSON."""
    if isinstance(value, bool | int | float | str | list | tuple | dict) or value is None:
        return value
    return value.isoformat() if hasattr(value, "isoformat") else str(value)


def _duration(seconds: float | None) -> str:
    return "" if seconds is None else str(timedelta(seconds=round(seconds)))
