"""`rigctl import`: data measured elsewhere becomes a run.

In: one or several files, the rig they were measured on, and options for what the files do not say. Out: a
run like any other, and its id; with `--dry-run` a preview and no run. The work is in
`rigctl.dataset.importing`: this module collects options, from the command line, a saved mapping or the
form of logs that the rig file names, and reports rows that were refused.

Options exist only for questions with more than one answer, such as the order of day and month; all else
is detected. The id alone goes to stdout, remarks and the next command go to stderr, so that a script can
take the id.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rigctl.cli.echo import echo, print_json
from rigctl.cli.options.as_json import Json
from rigctl.cli.progress import progress_display
from rigctl.errors import RigctlError
from rigctl.files.regular import read_text
from rigctl.wording import number_of

if TYPE_CHECKING:
    from rigctl.dataset.importing import Imported
    from rigctl.dataset.importing.options import Options
    from rigctl.dataset.importing.preview import Preview

#: most bad rows that are reported one by one
_TOLD = 20
#: the rig and the family that a rig or model file names
_RIG = re.compile(r"^rig:\s*['\"]?([^'\"\s#]+)", re.MULTILINE)
_FAMILY = re.compile(r"^model:\s*['\"]?([^'\"\s#]+)", re.MULTILINE)


def import_(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE...",
            help="CSV, XLSX, Parquet, TDMS, MDF4 or MAT files; several make one run.",
            show_default=False,
        ),
    ],
    *,
    rig: Annotated[
        Path | None,
        typer.Option(help="Rig file of the bench it was measured on; not needed for a table without time."),
    ] = None,
    columns: Annotated[
        list[str] | None,
        typer.Option(
            metavar="THEIRS=OURS",
            help="Channel or input that a column holds, where their names differ; repeatable. "
            "THEIRS=- skips the column.",
        ),
    ] = None,
    assume: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=VALUE",
            help="Constant value of an input that was not recorded, e.g. 'ambient=21 degC'; repeatable.",
        ),
    ] = None,
    missing: Annotated[
        list[str] | None,
        typer.Option(metavar="MARK", help="Additional mark for missing values, e.g. -9999; repeatable."),
    ] = None,
    dates: Annotated[
        str | None,
        typer.Option(
            metavar="ORDER",
            help="Order of ambiguous dates such as 03/04/2026: day-first, month-first or iso.",
        ),
    ] = None,
    zone: Annotated[
        str | None,
        typer.Option(
            metavar="ZONE", help="Time zone of times without one, e.g. Europe/Berlin; by default UTC."
        ),
    ] = None,
    times: Annotated[
        str | None,
        typer.Option(
            metavar="POLICY",
            help="What to do with rows whose time does not increase: refuse, drop, spread (equal "
            "times) or split (new record).",
        ),
    ] = None,
    split: Annotated[
        str | None,
        typer.Option(
            metavar="WAY",
            help="Start of a new record: command, command:NAME, gap, 'gap:10 s' or column:NAME.",
        ),
    ] = None,
    resample: Annotated[
        str | None,
        typer.Option(
            metavar="STEP|NAME",
            help="Common time base for channels with separate clocks: a step such as '100 ms', or "
            "the times of a column.",
        ),
    ] = None,
    encoding: Annotated[
        str | None, typer.Option(help="Encoding of a text file, e.g. cp1252; by default detected.")
    ] = None,
    delimiter: Annotated[
        str | None, typer.Option(metavar="SIGN", help="Character between cells; by default detected.")
    ] = None,
    decimal: Annotated[
        str | None, typer.Option(metavar="SIGN", help="Decimal mark, '.' or ','; by default detected.")
    ] = None,
    heading: Annotated[
        int | None,
        typer.Option(
            metavar="LINE",
            min=0,
            help="Line of the heading in a text file or on a sheet; 0 if there is none. Columns without a "
            "name have their number. By default detected.",
        ),
    ] = None,
    mapping: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Saved options for files of this logger.")
    ] = None,
    save_mapping: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Save all of these options for the next file.")
    ] = None,
    keep_good: Annotated[
        bool, typer.Option("--keep-good", help="Skip bad rows instead of refusing the file.")
    ] = False,
    name: Annotated[
        str | None, typer.Option(help="Name of the records; by default that in the file.")
    ] = None,
    dry_run: Annotated[
        bool,
        typer.Option(
            "--dry-run", help="Show what would be read, as a table and a figure, without making a run."
        ),
    ] = False,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="With --dry-run: .png or .svg file for the figure."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Import files of samples as a run, and print its id.

    The heading names each column with its unit: time [s], record, valve [1], oil_temperature [degC],
    supply_pressure [bar], pressure_setpoint [bar], position [mm], and any other channels of the rig. A table
    without time holds observations, one per row. Either the whole file is imported or nothing. The extension
    determines the format: .csv (also .csv.gz), .xlsx, .parquet, .tdms (LabVIEW), .mf4 (MDF4), .mat (MATLAB).

    Example: rigctl import strokes.csv --rig rigs/hl32-bench.yaml

    Example: rigctl import log.csv --rig rigs/hl32-bench.yaml --columns "Druck=supply_pressure [bar]"

    Example: rigctl import mon.csv tue.csv --rig rigs/heater-board.yaml --mapping lab.yaml --assume heater_2=0
    """
    if output is not None and not dry_run:
        raise RigctlError(
            "--output is the figure of a dry run", value=str(output), expected="--dry-run with it"
        )
    with progress_display(f"Reading {', '.join(file.name for file in files)}") as on_progress:
        from rigctl.dataset.importing import import_files
        from rigctl.dataset.importing.log_format import with_log_format
        from rigctl.dataset.importing.mapping import require_same_mapping
        from rigctl.dataset.importing.mapping import save_mapping as save
        from rigctl.dataset.importing.preview import preview_files
        from rigctl.project import find_file, find_project
        from rigctl.rig import load_rig

        # What is typed comes first, then the mapping of this call, or else the form of logs that the rig
        # names.
        options = _options(
            heading=heading,
            columns=columns,
            assume=assume,
            missing=missing,
            choices={
                "dates": dates,
                "zone": zone,
                "times": times,
                "split": split,
                "resample": resample,
                "encoding": encoding,
                "delimiter": delimiter,
                "decimal": decimal,
            },
            mapping=mapping,
        )
        paths = [find_file(file) for file in files]
        bench = load_rig(find_file(rig)) if rig is not None else None
        if mapping is None:
            options = with_log_format(options, bench)
        if save_mapping is not None:  # before there is a run, or a picture of it
            require_same_mapping(save_mapping, options)
        if dry_run:
            preview = preview_files(paths, bench, options)
        else:
            # The run is made here, completely or not at all; all that follows only reports it.
            done = import_files(
                paths,
                bench,
                find_project().runs,
                options,
                keep_good=keep_good,
                name=name,
                on_progress=on_progress,
            )
        if save_mapping is not None:
            save(save_mapping, options)
    if dry_run:
        _show(preview, paths[0], output, as_json=as_json)
        return
    # The id alone on stdout, for scripts; everything else on stderr.
    if not as_json:
        echo(done.run)
    _report_import(done, paths[0])
    if as_json:
        counts = {"records": done.records, "rows": done.rows, "left_out": done.left_out}
        document = {"run": done.run, "path": done.path.as_posix(), **counts, "notes": list(done.notes)}
        print_json(document)
    else:
        _suggest_next(rig, done.path)


def _show(preview: Preview, file: Path, output: Path | None, *, as_json: bool) -> None:
    """Show what would be read; errors in it go to stderr."""
    from rigctl.answers.import_preview import preview_blocks
    from rigctl.cli.blocks import show
    from rigctl.report.import_figure import write_preview

    for fault in preview.faults[:_TOLD]:
        echo(f"bad: {fault.error(file)}", err=True)
    if preview.bad_rows > _TOLD:
        echo(f"bad: {preview.bad_rows - _TOLD} more rows", err=True)
    for note in preview.notes:
        echo(f"note: {note}", err=True)
    if output is not None:
        echo(f"figure: {write_preview(preview, output)}", err=True)
    if as_json:
        print_json(preview.as_data())
    else:
        show(preview_blocks(preview))
        echo("Nothing was imported.", err=True)


def _options(
    *,
    columns: list[str] | None,
    assume: list[str] | None,
    missing: list[str] | None,
    heading: int | None,
    choices: Mapping[str, str | None],
    mapping: Path | None,
) -> Options:
    """The options of a file from the command line and a saved mapping; the command line has precedence."""
    from rigctl.dataset.assumptions import read_assumptions
    from rigctl.dataset.importing.columns import read_mapping
    from rigctl.dataset.importing.mapping import load_mapping
    from rigctl.dataset.importing.options import Options, checked_choices
    from rigctl.project import find_file

    options = Options(
        columns=read_mapping(columns or ()),
        assume=read_assumptions(assume or ()),
        missing=tuple(missing or ()),
        heading=heading,
        **checked_choices(choices),
    )
    return options.over(load_mapping(find_file(mapping))) if mapping is not None else options


def _suggest_next(rig: Path | None, run: Path) -> None:
    """Show the next command on stderr: compare with a model of this bench, else show the run."""
    from rigctl.command_line import DataOptions, analysis

    # The suggested command has to work as it stands: only a model that names this rig, or is of its family,
    # and without a rig one that predicts something in the run.
    model = _model_of(rig)
    if rig is None and model is not None and not _predicts(model, run):
        model = None
    command = "rigctl report latest"
    if model is not None:
        command = analysis("compare", ["latest"], model, DataOptions(family=_fmu_of(model, rig)))
    echo(f"Next: {command}", err=True)


def _fmu_of(model: str, rig: Path | None) -> str | None:
    """The FMU that the model's family file names, which only the command line lets run; None without one."""
    from rigctl.model import load_model
    from rigctl.printable import shown_path
    from rigctl.project import find_project

    path = find_project().root / model
    families = [_named(_FAMILY, one) for one in (path, rig) if one is not None and one.is_file()]
    if not any(name is not None and name.endswith((".yaml", ".yml")) for name in families):
        return None  # a family of the library
    try:
        program = load_model(path).family.program
    except RigctlError:  # the next command says what is wrong
        return None
    file = None if program is None or program.location is None else program.location.file
    if not isinstance(file, Path):
        return None
    here = Path.cwd()
    return shown_path(file.relative_to(here) if file.is_relative_to(here) else file)


def _predicts(model: str, run: Path) -> bool:
    """Whether a model of the project predicts a column of an imported run."""
    from rigctl.dataset import open_run
    from rigctl.model import load_model
    from rigctl.project import find_project

    try:
        outputs = {output.name for output in load_model(find_project().root / model).family.outputs}
    except RigctlError:
        return False
    opened = open_run(run)
    measured = {name for index in opened.usable for name in opened.record(index).measures}
    return bool(outputs & {*opened.layout.channels, *measured})


def _model_of(rig: Path | None) -> str | None:
    """A model of the project that names this rig file, else one of its family; without a rig, one that names
    none."""
    from rigctl.project import find_project

    root = find_project().root
    family = _named(_FAMILY, rig) if rig is not None and rig.is_file() else None
    alike = None
    # Only the lines that name rig and family are looked at, and no model is read for it.
    for path in sorted((root / "models").glob("*.yaml")):
        if _named(_RIG, path) == (rig.as_posix() if rig is not None else None):
            return path.relative_to(root).as_posix()
        if alike is None and family is not None and _named(_FAMILY, path) == family:
            alike = path.relative_to(root).as_posix()
    return alike


def _named(field: re.Pattern[str], path: Path) -> str | None:
    """The value of a field at the top of a file."""
    match = field.search(read_text(path, errors="replace"))
    return match.group(1) if match else None


def _report_import(done: Imported, file: Path) -> None:
    """Show bad rows, notes and the amount of data on stderr."""
    for fault in done.faults[:_TOLD]:
        echo(f"left out: {fault.error(file)}", err=True)
    if done.left_out > _TOLD:
        echo(f"left out: {done.left_out - _TOLD} more rows, see the run's events", err=True)
    for note in done.notes:
        echo(f"note: {note}", err=True)
    records = number_of(done.records, "record")
    echo(f"{records}, {done.rows} rows in {done.path.as_posix()}", err=True)
