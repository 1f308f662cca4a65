"""`rigctl family new`: a first family, rig, procedure and model file, from data or from a template.

In: a log, the kind of model or an FMU, and what the user says about columns. Out: four text files in the
project, each with reasons as comments, a first fit and its figure, and the commands that lead on.
`rigctl.proposal` drafts them; this module reads options, writes files and words questions.

Files, and not a dialogue: they can be reviewed, repeated, and edited. What the log does not tell is asked
at the end, as the line that drafts again with the answer. The files are read, and the log is imported
with them, as by any command, before they count as written: if either fails, none of them remains. A fit
that fails is only reported.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rigctl.cli.commands.init import mark_project
from rigctl.cli.echo import echo, print_json
from rigctl.cli.options.as_json import Json
from rigctl.command_line import quoted, shell_word
from rigctl.errors import Location, RigctlError

if TYPE_CHECKING:
    from rigctl.cli.commands.family.first_fit import FirstFit
    from rigctl.proposal.columns import Column, Table
    from rigctl.proposal.propose import Proposal
    from rigctl.proposal.roles import StatedRoles

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    help="A family of models of your own. 'rigctl check' checks its file, 'rigctl effects list --slots "
    "--family FILE' shows where effects can act.",
)

_NAME = re.compile(r"[a-z][a-z0-9_]{0,63}")


@app.callback()
def _group() -> None:
    pass


@app.command()
def new(
    name: Annotated[str, typer.Argument(help="Name of the bench, e.g. pump_test.", show_default=False)],
    *,
    csv: Annotated[
        Path | None,
        typer.Option(
            "--csv", metavar="FILE", help="Measurements: CSV, or another format that 'rigctl import' reads."
        ),
    ] = None,
    template: Annotated[
        str | None,
        typer.Option(
            help="Kind of model: first-order, second-order, mass-spring-damper, driven-mass, motor, tank, "
            "heater, flow or linear; by default the simplest of first-order, second-order, driven-mass and "
            "linear that explains the data.",
            show_default=False,
        ),
    ] = None,
    fmu: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="FMU that is the model, in place of a template; its description is read, and it is not run.",
            show_default=False,
        ),
    ] = None,
    variable: Annotated[
        list[str] | None,
        typer.Option(
            metavar="COLUMN=NAME",
            help="Input or output of the FMU that a column is, where their names differ; repeatable.",
        ),
    ] = None,
    condition: Annotated[
        list[str] | None,
        typer.Option(
            metavar="COLUMN",
            help="Column with which parameters of the FMU may change, and that the FMU does not have; "
            "repeatable.",
        ),
    ] = None,
    inputs: Annotated[
        list[str] | None,
        typer.Option("--input", metavar="COLUMN", help="Column that is an input; repeatable."),
    ] = None,
    commanded: Annotated[
        list[str] | None,
        typer.Option(
            metavar="COLUMN",
            help="Input that is commanded, and so known exactly: an actuator; repeatable.",
        ),
    ] = None,
    measured: Annotated[
        list[str] | None,
        typer.Option(
            metavar="COLUMN", help="Input that is measured, and may have noise: a channel; repeatable."
        ),
    ] = None,
    outputs: Annotated[
        list[str] | None,
        typer.Option("--output", metavar="COLUMN", help="Column that is an output; repeatable."),
    ] = None,
    leave: Annotated[
        list[str] | None, typer.Option(metavar="COLUMN", help="Column to leave out; repeatable.")
    ] = None,
    unit: Annotated[
        list[str] | None,
        typer.Option(
            metavar="COLUMN=UNIT",
            help="Unit of a column without one, or the time from row to row of one that numbers the rows: "
            "'Sample=50 ms'; repeatable.",
        ),
    ] = None,
    dates: Annotated[str | None, typer.Option(metavar="ORDER", help="As for 'rigctl import'.")] = None,
    times: Annotated[str | None, typer.Option(metavar="POLICY", help="As for 'rigctl import'.")] = None,
    missing: Annotated[
        list[str] | None, typer.Option(metavar="MARK", help="As for 'rigctl import'; repeatable.")
    ] = None,
    encoding: Annotated[str | None, typer.Option(help="As for 'rigctl import'.")] = None,
    delimiter: Annotated[str | None, typer.Option(metavar="SIGN", help="As for 'rigctl import'.")] = None,
    decimal: Annotated[str | None, typer.Option(metavar="SIGN", help="As for 'rigctl import'.")] = None,
    heading: Annotated[
        int | None, typer.Option(metavar="LINE", min=0, help="As for 'rigctl import'.")
    ] = None,
    fit: Annotated[
        bool, typer.Option("--fit/--no-fit", help="Fit the draft to the data once, and plot both.")
    ] = True,
    as_json: Json = False,
) -> None:
    """Write draft family, rig, procedure and model files for editing; nothing is overwritten.

    From a file of measurements it determines which columns are inputs (constant except for steps, imposed
    from outside, or leading all others) and which are outputs, whether an input is commanded or measured, and
    estimates starting values of the parameters. A file that 'rigctl import' would refuse is refused, and
    nothing is written.

    Example: rigctl family new motor --csv log.csv --template motor

    Example: rigctl family new damper --csv log.csv --measured velocity

    Example: rigctl family new oven --template heater

    Example: rigctl family new drive --fmu motor.fmu --csv log.csv
    """
    from rigctl.cli.plans import read_assignments
    from rigctl.dataset.importing.options import Options, checked_choices
    from rigctl.project import find_file
    from rigctl.proposal.columns import read_columns
    from rigctl.proposal.from_columns import UnfittingError
    from rigctl.proposal.propose import empty_table, find_template, propose
    from rigctl.proposal.roles import StatedRoles, with_roles

    # What contradicts itself is refused before the log is read.
    if csv is None and template is None and fmu is None:
        raise RigctlError(
            "nothing to begin with", expected="--csv FILE, --template NAME, both, or --fmu FILE"
        )
    if template is not None:
        find_template(template)
    _refuse_contradictions(
        fmu, {"--template": template, "--input": inputs, "--output": outputs}, variable, condition
    )
    called = _name(name)
    # The log is read by a function that is given the units, because an FMU may state those that the log
    # does not.
    reading: Callable[[Mapping[str, str]], Table] | None = None
    if csv is not None:
        choices = {
            "dates": dates,
            "times": times,
            "encoding": encoding,
            "delimiter": delimiter,
            "decimal": decimal,
        }
        options = Options(missing=tuple(missing or ()), heading=heading, **checked_choices(choices))
        reading = partial(read_columns, find_file(csv), options=options)
    stated = StatedRoles(inputs or (), outputs or (), leave or (), commanded or (), measured or ())
    units = read_assignments(unit or (), "--unit")
    if fmu is not None:
        variables = read_assignments(variable or (), "--variable")
        _finish(
            _of_fmu(called, find_file(fmu), reading, units, stated, variables, condition or ()),
            "",
            fit=False,
            as_json=as_json,
        )
        return
    # Without an FMU: what each column is, then equations that fit these columns.
    table = empty_table(template or "") if reading is None else with_roles(reading(units), stated)
    stated_options = _options(csv, inputs, commanded, measured, outputs, leave, unit, import_options(table))
    try:
        proposal = propose(called, table, template)
    except UnfittingError as problem:
        command = f"rigctl family new {shell_word(name)} {stated_options}"
        command += "" if template is None else f" --template {template}"
        raise _with_units(problem, command, table) from None
    _finish(proposal, stated_options, fit=fit, as_json=as_json)


def _finish(proposal: Proposal, options: str, *, fit: bool, as_json: bool) -> None:
    """Write the files, fit the model to the log once, and show both."""
    from rigctl.project import find_project

    root = find_project().root
    # The fit is within, as the import before it may refuse the log: then none of the files remains.
    with _written(root, proposal) as written:
        tried = _tried(proposal, root, fit=fit)
    document = _document(proposal, written, options, tried)
    if as_json:
        print_json(document)
    else:
        _show(document, proposal, options, tried)


def _refuse_contradictions(
    fmu: Path | None,
    without: Mapping[str, object],
    variable: Sequence[str] | None,
    condition: Sequence[str] | None,
) -> None:
    """Refuse options that an FMU makes void, and those that need one."""
    if fmu is None and variable:
        raise RigctlError("--variable is for the variables of an FMU", expected="--fmu FILE")
    if fmu is None and condition:
        raise RigctlError("--condition is for the parameters of an FMU", expected="--fmu FILE")
    for option, given in without.items():
        if fmu is not None and given:
            raise RigctlError(
                f"--fmu and {option} exclude each other: an FMU has its own equations, inputs and outputs",
                expected="one of them",
            )


def _of_fmu(
    name: str,
    path: Path,
    reading: Callable[[Mapping[str, str]], Table] | None,
    units: Mapping[str, str],
    stated: StatedRoles,
    variables: Mapping[str, str],
    conditions: Sequence[str],
) -> Proposal:
    """The draft for an FMU; `reading` reads the log, with the units of columns that state none."""
    from rigctl.fmu.description import read_description
    from rigctl.project import find_project
    from rigctl.proposal.fmu import pair, propose_fmu, table_of_fmu, units_from, with_fmu_roles

    about = read_description(path)
    root, here = find_project().root.resolve(), path.resolve()
    written = (here.relative_to(root) if here.is_relative_to(root) else here).as_posix()
    # Without a log the channels of the bench are the variables of the FMU.
    if reading is None:
        table, pairs = table_of_fmu(about)
        return propose_fmu(name, about, written, table, pairs)
    table = reading(units)
    pairs = pair(table, about, variables, stated.omitted, conditions)
    # Read once more with the units of the FMU, where the log states none; those of the user come first.
    own = units_from(table, about, pairs)
    if own:
        table = reading({**own, **units})
    return propose_fmu(name, about, written, with_fmu_roles(table, about, pairs, stated), pairs, own)


def _name(written: str) -> str:
    name = re.sub(r"[^a-z0-9]+", "_", written.strip().casefold()).strip("_")
    if not _NAME.fullmatch(name):
        raise RigctlError(
            "not a valid name for a family", value=written, expected="a letter, then letters, digits and _"
        )
    from rigctl.files.reserved_names import is_reserved
    from rigctl.physics.families import FAMILIES

    if is_reserved(name):  # on every system: a project is shared
        raise RigctlError("a device on Windows has this name", value=name, expected="another name")
    if name in FAMILIES:
        raise RigctlError("there is a model family of this name already", value=name, expected="another name")
    return name


@contextmanager
def _written(root: Path, proposal: Proposal) -> Iterator[list[Path]]:
    """The drafted files, which every command can read; on an error in the block none of them remains."""
    folders = [folder for folder in {(root / name).parent for name in proposal.files} if not folder.exists()]
    written = _write(root, proposal.files)
    # files name each other from the project's root: without a project they would not be found
    marker = mark_project(root)
    written += [marker] if marker is not None else []
    try:
        _check(root, proposal)
        yield written
    except BaseException:
        for path in written:
            path.unlink()
        for folder in folders:
            folder.rmdir()
        raise


def _write(root: Path, files: Mapping[str, str]) -> list[Path]:
    from rigctl.files.write import write_text

    paths = [root / name for name in files]
    for path in paths:
        if path.exists():
            raise RigctlError(
                "the file is already there and nothing is overwritten",
                where=Location(path),
                hint="Choose another name",
            )
    for path, text in zip(paths, files.values(), strict=True):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, text)
    return paths


def _check(root: Path, proposal: Proposal) -> None:
    """Read all files as any command does; an error in them is a fault of rigctl, and they are removed."""
    from rigctl.model import load_model
    from rigctl.model.rig_family import family_of
    from rigctl.physics.user import load_family
    from rigctl.procedure import expand, load_procedure
    from rigctl.rig import load_rig

    load_family(root / proposal.family)
    rig = load_rig(root / proposal.rig)
    family_of(rig)
    expand(load_procedure(root / proposal.procedure), rig, {})
    load_model(root / proposal.model)


def _tried(proposal: Proposal, root: Path, *, fit: bool) -> FirstFit | None:
    """The first fit to the imported file, which is not kept; None without a file.

    Raises
    ------
    RigctlError
        `rigctl import` refuses the file.
    """
    from rigctl.cli.commands.family.first_fit import first_fit
    from rigctl.dataset.importing import import_file
    from rigctl.proposal.log_format import column_pairs
    from rigctl.rig import load_rig

    table = proposal.table
    if table.path is None:
        return None
    with tempfile.TemporaryDirectory(prefix="rigctl-") as folder:
        rig = load_rig(root / proposal.rig)
        columns = column_pairs(table)
        options = replace(table.options, times=table.policy or table.options.times)
        done = import_file(table.path, rig, Path(folder), columns=columns, options=options)
        return first_fit(proposal, root, done.path, fit=fit)


def import_options(table: Table) -> str:
    """The other options of `rigctl import` for the file, each with a space before it."""
    options = table.options
    chosen = {
        "times": options.times,
        "dates": options.dates,
        "encoding": options.encoding,
        "delimiter": options.delimiter,
        "decimal": options.decimal,
        "heading": None if options.heading is None else str(options.heading),
    }
    written = "".join(f" --{key} {shell_word(text)}" for key, text in chosen.items() if text is not None)
    return written + "".join(f" --missing {shell_word(mark)}" for mark in options.missing)


def _options(
    csv: Path | None,
    inputs: Iterable[str] | None,
    commanded: Iterable[str] | None,
    measured: Iterable[str] | None,
    outputs: Iterable[str] | None,
    leave: Iterable[str] | None,
    unit: Iterable[str] | None,
    reading: str,
) -> str:
    """The options of this command for the same file with another template."""
    repeated = {
        "input": inputs,
        "commanded": commanded,
        "measured": measured,
        "output": outputs,
        "leave": leave,
        "unit": unit,
    }
    text = "".join(
        f" --{option} {shell_word(value)}" for option, values in repeated.items() for value in values or ()
    )
    return "" if csv is None else f"--csv {shell_word(csv.as_posix())}{text}{reading}"


def _commands(proposal: Proposal) -> list[str]:
    """Show the next commands."""
    commands = []
    table = proposal.table
    if table.path is not None:
        policy = "" if table.policy is None else f" --times {table.policy}"
        commands.append(f"rigctl import {shell_word(table.path.as_posix())} --rig {proposal.rig}{policy}")
        allowed = "" if proposal.fmu is None else f" --family {shell_word(proposal.fmu)}"
        commands.append(f"rigctl compare latest --model {proposal.model}{allowed}")
    if proposal.fmu is None:
        commands.append(f"rigctl simulate {proposal.procedure}")
    commands.append(f"rigctl effects list --slots --family {proposal.family}")
    return commands


def _document(
    proposal: Proposal, written: Iterable[Path], again: str, tried: FirstFit | None
) -> dict[str, Any]:
    other = tried.other_template(proposal) if tried is not None else None
    return {
        "name": proposal.name,
        "template": proposal.template,
        "fmu": proposal.fmu,
        "family": proposal.family,
        "rig": proposal.rig,
        "model": proposal.model,
        "procedure": proposal.procedure,
        "files": [path.as_posix() for path in written],
        "columns": [
            {
                "name": column.name,
                "theirs": column.theirs,
                "unit": column.unit,
                "unit_stated": column.stated,
                "role": column.role,
                "origin": column.origin if column.role == "input" else None,
                "reason": column.reason,
            }
            for column in proposal.table.columns
        ],
        "fit": None if tried is None else tried.document(),
        "plot": None if tried is None or tried.plot is None else tried.plot.as_posix(),
        "other": None
        if other is None
        else f"rigctl family new {proposal.name}_{other.replace('-', '_')} {again} --template {other}",
        "notes": list(proposal.notes),
        "next": _commands(proposal),
    }


def _with_units(problem: RigctlError, command: str, table: Table) -> RigctlError:
    """The refusal of a template, with the command that states the units which the log does not."""
    unknown, units = _without_unit(table)
    if not unknown:
        return problem
    names = ", ".join(column.theirs for column in unknown)
    problem.hint = (
        f"The log states no unit for {names}. Give them, e.g. V, rpm, bar or degC for UNIT: "
        f"{command}{units}; or leave out --template"
    )
    return problem


def _without_unit(table: Table) -> tuple[list[Column], str]:
    """The columns of which the log states no unit, and the options that would state them."""
    unknown = [column for column in table.columns if not column.known and column.role != "left out"]
    return unknown, "".join(f" --unit {quoted(f'{column.theirs}=UNIT')}" for column in unknown)


def _show(document: Mapping[str, Any], proposal: Proposal, options: str, tried: FirstFit | None) -> None:
    from rigctl.cli.tables import console, table

    # How each column was understood and what was written; then how well it fits, and last what only the
    # user knows, with the command that says it.
    if any(column["reason"] for column in document["columns"]):
        listed = table("column", "is", "unit", "why")
        known = {column.theirs: column.known for column in proposal.table.columns}
        for column in document["columns"]:
            unit = column["unit"] if known[column["theirs"]] or column["role"] == "left out" else "not stated"
            role = {"commanded": "input, commanded", "measured": "input, measured", "unclear": "input"}.get(
                column["origin"] or "", column["role"]
            )
            listed.add_row(column["theirs"], role, unit, column["reason"])
        console().print(listed)
    if proposal.template is not None:
        echo(f"template: {proposal.template}")
    for path in document["files"]:
        echo(f"  {path}")
    for line in tried.lines() if tried is not None else ():
        echo(line)
    for line in (*_questions(document["columns"]), *_unstated_units(proposal, options), *proposal.notes):
        echo(line)
    if document["other"] is not None:
        echo(f"Another template explains more: {document['other']}")
    echo("Edit these files; 'rigctl check FILE' says what is wrong with one.")
    for index, command in enumerate(document["next"]):
        echo(f"{'Next: ' if index == 0 else '      '}{command}")


def _unstated_units(proposal: Proposal, options: str) -> Iterator[str]:
    """Which units the log does not state, and the command that states them."""
    # Only a log leaves units open: those of templates are known, and those of an FMU are in its
    # description.
    unknown, units = _without_unit(proposal.table)
    if not unknown or proposal.table.path is None or proposal.fmu is not None:
        return
    names = ", ".join(c.theirs + (f" ('{c.unread}' is no unit)" if c.unread else "") for c in unknown)
    yield (
        f"The log states no unit for {names}: drafted as plain numbers. With a unit for each UNIT (V, rpm, "
        f"bar …), this drafts it again: rigctl family new {proposal.name}_2 {options}{units}"
    )


def _questions(columns: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """What only the user knows of the inputs."""
    for column in columns:
        if column["origin"] == "unclear":
            option = f"--commanded {quoted(column['theirs'])}"
            yield (
                f"Is {column['theirs']} a command, and so known exactly, or measured? The log does not tell. "
                f"It is drafted as measured; {option} makes it a command, --measured confirms the draft"
            )
