"""`rigctl family new`: a first family, rig, procedure and model file, from data or from a template."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rigctl.cli.commands.init import mark_project
from rigctl.cli.echo import echo, echo_json
from rigctl.errors import Location, RigctlError

if TYPE_CHECKING:
    from rigctl.cli.commands.first_fit import FirstFit
    from rigctl.proposal.columns import Table
    from rigctl.proposal.propose import Proposal

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
            help="Kind of model: first-order, second-order, mass-spring-damper, motor, tank, "
            "heater, flow or linear.",
            show_default=False,
        ),
    ] = None,
    inputs: Annotated[
        list[str] | None,
        typer.Option("--input", metavar="COLUMN", help="Column that is an input; repeatable."),
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
        typer.Option(metavar="COLUMN=UNIT", help="Unit of a column without one; repeatable."),
    ] = None,
    fit: Annotated[
        bool, typer.Option("--fit/--no-fit", help="Fit the draft to the data once, and plot both.")
    ] = True,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON document on stdout.")] = False,
) -> None:
    """Write draft family, rig, procedure and model files for editing; nothing is overwritten.

    From a file of measurements it determines which columns are inputs (constant except for steps, imposed
    from outside, or leading all others) and which are outputs, and estimates starting values of the
    parameters. Without --template every output is a first-order lag of the inputs.

    Example: rigctl family new motor --csv log.csv --template motor

    Example: rigctl family new oven --template heater
    """
    from rigctl.cli.commands.first_fit import first_fit
    from rigctl.cli.plans import read_assignments
    from rigctl.project import find_file, find_project
    from rigctl.proposal.columns import read_columns
    from rigctl.proposal.propose import empty_table, find_template, propose
    from rigctl.proposal.roles import with_roles

    if csv is None and template is None:
        raise RigctlError("nothing to begin with", expected="--csv FILE, --template NAME, or both")
    if template is not None:
        find_template(template)
    called = _name(name)
    if csv is None:
        table = empty_table(template or "")
    else:
        units = read_assignments(unit or (), "--unit")
        table = with_roles(read_columns(find_file(csv), units), inputs or (), outputs or (), leave or ())
    proposal = propose(called, table, template)
    root = find_project().root
    # files name each other from the project's root: without a project they would not be found
    marker = mark_project(root)
    written = [*_write(root, proposal.files), *([marker] if marker is not None else [])]
    try:
        _check(root, proposal)
    except RigctlError:
        for path in written:
            path.unlink()
        raise
    arguments = import_arguments(table)
    tried = None
    if csv is not None:
        tried = first_fit(proposal, root, arguments, fit=fit)
    document = _document(proposal, written, arguments, tried)
    if as_json:
        from rigctl.files.write import to_json

        echo_json(to_json(document))
    else:
        _show(document, tried)


def _name(written: str) -> str:
    name = re.sub(r"[^a-z0-9]+", "_", written.strip().casefold()).strip("_")
    if not _NAME.fullmatch(name):
        raise RigctlError(
            "not a valid name for a family", value=written, expected="a letter, then letters, digits and _"
        )
    from rigctl.physics.families import FAMILIES

    if name in FAMILIES:
        raise RigctlError("there is a model family of this name already", value=name, expected="another name")
    return name


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


def import_arguments(table: Table) -> list[str]:
    """The option `--columns` of `rigctl import` for the file."""
    omitted = {column.theirs for column in table.columns if column.role == "left out"}
    renamed = [text for text in table.renamed if text.partition("=")[0] not in omitted]
    return [*renamed, *(f"{theirs}=-" for theirs in sorted(omitted))]


def _commands(proposal: Proposal, arguments: Sequence[str]) -> list[str]:
    """Show the next commands."""
    commands = []
    if proposal.table.path is not None:
        columns = "".join(f' --columns "{text}"' for text in arguments)
        copies = " --times drop" if proposal.table.copies else ""
        commands.append(
            f"rigctl import {proposal.table.path.as_posix()} --rig {proposal.rig}{columns}{copies}"
        )
        commands.append(f"rigctl compare latest --model {proposal.model}")
    commands.append(f"rigctl simulate {proposal.procedure}")
    commands.append(f"rigctl effects list --slots --family {proposal.family}")
    return commands


def _document(
    proposal: Proposal, written: Iterable[Path], arguments: Sequence[str], tried: FirstFit | None
) -> dict[str, Any]:
    return {
        "name": proposal.name,
        "template": proposal.template,
        "family": proposal.family,
        "rig": proposal.rig,
        "model": proposal.model,
        "procedure": proposal.procedure,
        "files": [str(path) for path in written],
        "columns": [
            {
                "name": column.name,
                "theirs": column.theirs,
                "unit": column.unit,
                "unit_stated": column.stated,
                "role": column.role,
                "reason": column.reason,
            }
            for column in proposal.table.columns
        ],
        "fit": None if tried is None else tried.document(),
        "plot": None if tried is None or tried.plot is None else str(tried.plot),
        "next": _commands(proposal, arguments),
    }


def _show(document: Mapping[str, Any], tried: FirstFit | None) -> None:
    from rigctl.cli.tables import console, table

    if any(column["reason"] for column in document["columns"]):
        listed = table("column", "is", "unit", "why")
        for column in document["columns"]:
            unit = (
                column["unit"]
                if column["unit"] != "1" or column["unit_stated"]
                else "none; give it with --unit"
            )
            listed.add_row(column["theirs"], column["role"], unit, column["reason"])
        console().print(listed)
    for path in document["files"]:
        echo(f"  {path}")
    if tried is not None:
        for line in tried.lines():
            echo(line)
    echo("Edit these files; 'rigctl check FILE' says what is wrong with one.")
    for index, command in enumerate(document["next"]):
        echo(f"{'Next: ' if index == 0 else '      '}{command}")
