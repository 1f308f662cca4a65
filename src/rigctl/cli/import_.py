"""`rigctl import`: data that was measured elsewhere becomes a run."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from rigctl.dataset.importing import Imported

#: so many bad rows are told one by one
_TOLD = 20
#: the rig that a model file names
_RIG = re.compile(r"^rig:\s*['\"]?([^'\"\s#]+)", re.MULTILINE)


def import_(
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="CSV, Parquet, TDMS, MDF4 or MAT.", show_default=False)
    ],
    *,
    rig: Annotated[
        Path | None,
        typer.Option(help="The rig file of the bench it was measured on; a table without time needs none."),
    ] = None,
    columns: Annotated[
        list[str] | None,
        typer.Option(
            metavar="THEIRS=OURS",
            help="What a column is, where its name differs; repeatable. THEIRS=- leaves it out.",
        ),
    ] = None,
    keep_good: Annotated[
        bool, typer.Option("--keep-good", help="Leave bad rows out instead of refusing the file.")
    ] = False,
    name: Annotated[
        str | None, typer.Option(help="Name of the records; by default what the file calls them.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON document on stdout.")] = False,
) -> None:
    """Bring in a file of samples as a run, and print the run's id.

    The heading names each column with its unit: time [s], record, valve [1], oil_temperature [degC],
    supply_pressure [bar], pressure_setpoint [bar], position [mm], and what else the rig has. A table without
    time holds observations, one in each row. All of the file is imported or nothing. The end of the name says
    what the file is: .csv (also .csv.gz), .parquet, .tdms (LabVIEW), .mf4 (MDF4), .mat (MATLAB).

    Example: rigctl import strokes.csv --rig rigs/hl32-bench.yaml

    Example: rigctl import log.csv --rig rigs/hl32-bench.yaml --columns "Druck=supply_pressure [bar]"
    """
    from rigctl.cli.plans import find_file
    from rigctl.dataset.importing import import_file
    from rigctl.files.write import to_json
    from rigctl.project import find_project
    from rigctl.rig import load_rig

    done = import_file(
        find_file(file),
        load_rig(find_file(rig)) if rig is not None else None,
        find_project().runs,
        columns=columns or (),
        keep_good=keep_good,
        name=name,
    )
    if not as_json:
        typer.echo(done.run)
    _tell(done, file)
    if as_json:
        counts = {"records": done.records, "rows": done.rows, "left_out": done.left_out}
        document = {"run": done.run, "path": str(done.path), **counts, "notes": list(done.notes)}
        typer.echo(to_json(document))
    else:
        _lead_on(rig)


def _lead_on(rig: Path | None) -> None:
    """What to type next, on stderr: compare it with a model of this bench, else look at it."""
    from rigctl.cli.next_command import analysis

    model = _model_of(rig)
    command = "rigctl report latest" if model is None else analysis("compare", ["latest"], model)
    typer.echo(f"Next: {command}", err=True)


def _model_of(rig: Path | None) -> str | None:
    """A model of the project that names this rig file; without a rig, one that names none."""
    from rigctl.project import find_project

    root = find_project().root
    for path in sorted((root / "models").glob("*.yaml")):
        named = _RIG.search(path.read_text(encoding="utf-8", errors="replace"))
        if (named.group(1) if named else None) == (rig.as_posix() if rig is not None else None):
            return path.relative_to(root).as_posix()
    return None


def _tell(done: Imported, file: Path) -> None:
    """What is worth knowing, on stderr: bad rows, notes, how much there is."""
    for fault in done.faults[:_TOLD]:
        typer.echo(f"left out: {fault.error(file)}", err=True)
    if done.left_out > _TOLD:
        typer.echo(f"left out: {done.left_out - _TOLD} more rows, see the run's events", err=True)
    for note in done.notes:
        typer.echo(f"note: {note}", err=True)
    records = f"{done.records} record{'' if done.records == 1 else 's'}"
    typer.echo(f"{records}, {done.rows} rows in {done.path}", err=True)
