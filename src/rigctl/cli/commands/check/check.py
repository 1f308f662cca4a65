"""`rigctl check`: validate a file; for a procedure, print its plan."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from rigctl.cli.echo import echo, print_json
from rigctl.cli.options.as_json import Json
from rigctl.cli.options.family import FamilyOption, check_family_of
from rigctl.cli.options.procedure import ArgumentOption
from rigctl.cli.progress import progress_display
from rigctl.errors import RigctlError

#: a plan's tree is wide
_PIPED_WIDTH = 200


def check(
    file: Annotated[
        Path,
        typer.Argument(
            metavar="FILE", help="Procedure, rig, model, family or effect file.", show_default=False
        ),
    ],
    arg: ArgumentOption = None,
    rig: Annotated[Path | None, typer.Option(help="Another rig file than the one it names.")] = None,
    family: FamilyOption = None,
    *,
    everything: Annotated[bool, typer.Option("--all", help="Show every point of every sweep.")] = False,
    as_json: Json = False,
) -> None:
    """Validate a file and report what kind it is; for a procedure, print its plan: steps, records, duration,
    limits.

    Nothing moves and no bench is needed. Only the first point of each sweep is shown; --all shows every
    point.

    Example: rigctl check procedures/campaign.yaml --arg shuffle=7

    Example: rigctl check rigs/my-bench.yaml
    """
    from rigctl.cli.commands.check.files import kind_of
    from rigctl.project import find_file

    path = find_file(file)
    kind = kind_of(path)
    if kind == "procedure":
        _check_procedure(path, rig, arg or (), everything=everything, as_json=as_json)
    else:
        _check_other(kind, path, rig, arg or (), as_json=as_json)


def _check_other(kind: str, path: Path, rig: Path | None, arg: Sequence[str], *, as_json: bool) -> None:
    if rig is not None or arg:
        what = f"--rig and --arg are for procedures, and this is a {kind} file"
        raise RigctlError(what, value=path.as_posix())
    with progress_display(f"Reading {path.as_posix()}"):
        from rigctl.cli.commands.check.files import describe, lines

        document = describe(kind, path)
    if as_json:
        print_json(document, indent=1)
    else:
        echo("\n".join(lines(document)))


def _check_procedure(
    procedure: Path, rig: Path | None, arg: Sequence[str], *, everything: bool, as_json: bool
) -> None:
    from datetime import UTC, datetime

    with progress_display(f"Reading {procedure.as_posix()}"):
        from rigctl.cli.plans import open_plan
        from rigctl.planning import preview
        from rigctl.planning.document import as_document
        from rigctl.planning.lost_devices import refuse_needed
        from rigctl.planning.outline import outline
        from rigctl.planning.rates import refuse_rates

        plan = open_plan(procedure, rig, arg)
        check_family_of(plan.rig)
        refuse_rates(plan)
        refuse_needed(plan)
        forecast = preview(plan)
    warnings = forecast.plan.rig.warnings(datetime.now(UTC).date())
    if as_json:
        document = {"kind": "procedure", **as_document(forecast, warnings)}
        print_json(document, indent=1)
        return
    from rigctl.cli.tables import console

    out = console(piped_width=_PIPED_WIDTH)
    for part in outline(forecast, warnings, everything=everything):
        out.print(part)
