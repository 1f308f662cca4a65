"""`rigctl check`: validate a procedure and print what it would do."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from rigctl.cli.family import FamilyOption, check_family_of

_PIPED_WIDTH = 200


def check(
    procedure: Annotated[Path, typer.Argument(help="The procedure file.", show_default=False)],
    arg: Annotated[
        list[str] | None,
        typer.Option("--arg", "-a", metavar="NAME=VALUE", help="An argument of the procedure; repeatable."),
    ] = None,
    rig: Annotated[Path | None, typer.Option(help="Another rig file than the one it names.")] = None,
    family: FamilyOption = None,
    *,
    everything: Annotated[bool, typer.Option("--all", help="Show every point of every sweep.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON document on stdout.")] = False,
) -> None:
    """Validate a procedure and print its plan: steps, records, sweep sizes, expected duration, limits.

    Nothing moves and no bench is needed. Sweeps show their first point; --all shows them whole.

    Example: rigctl check procedures/campaign.yaml --arg shuffle=7
    """
    from datetime import UTC, datetime

    from rigctl.cli.plans import open_plan
    from rigctl.planning import preview
    from rigctl.planning.document import as_document
    from rigctl.planning.outline import outline

    plan = open_plan(procedure, rig, arg or ())
    check_family_of(plan.rig)
    seen = preview(plan)
    warnings = seen.plan.rig.warnings(datetime.now(UTC).date())
    if as_json:
        typer.echo(json.dumps(as_document(seen, warnings), indent=1, ensure_ascii=False))
        return
    from rich.console import Console

    console = Console(highlight=False)
    if not console.is_terminal:
        console.width = _PIPED_WIDTH
    for part in outline(seen, warnings, everything=everything):
        console.print(part)
