"""`rigctl run`: carry out a procedure on the bench."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rigctl.cli.options.as_json import Json
from rigctl.cli.options.driver import AllowDriverOption
from rigctl.cli.options.family import FamilyOption
from rigctl.cli.options.identity import NotesOption, PartOption, SerialNumberOption
from rigctl.cli.options.port import PortOption
from rigctl.cli.options.procedure import ArgumentOption, RigOption
from rigctl.cli.options.serve import ServeOption


def run(
    procedure: Annotated[Path, typer.Argument(help="Procedure file.", show_default=False)],
    recording: Annotated[
        str | None, typer.Argument(metavar="RUN", help="With '--backend replay': run to play back.")
    ] = None,
    backend: Annotated[
        str | None,
        typer.Option(
            help="serial, modbus, visa, opcua, python, emulated, simulated or replay; by default that of "
            "the rig file."
        ),
    ] = None,
    port: PortOption = None,
    allow_driver: AllowDriverOption = None,
    rig: RigOption = None,
    arg: ArgumentOption = None,
    operator: Annotated[str | None, typer.Option(help="Person in charge; kept with the run.")] = None,
    serial_number: SerialNumberOption = None,
    part: PartOption = None,
    notes: NotesOption = None,
    answer: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=VALUE", help="Answer to an operator's question, given in advance; repeatable."
        ),
    ] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Seed for a simulated bench.")] = None,
    speed: Annotated[
        str, typer.Option(help="1x; for a simulated, emulated or replayed bench also 10x or max.")
    ] = "1x",
    family: FamilyOption = None,
    *,
    dry: Annotated[bool, typer.Option("--dry", help="Arm and read, but move nothing.")] = False,
    answer_in_browser: Annotated[
        bool,
        typer.Option("--answer-in-browser", help="Have questions answered on the page of 'rigctl serve'."),
    ] = False,
    serve: ServeOption = False,
    as_json: Json = False,
) -> None:
    """Carry out a procedure on the bench and record it.

    Keys while it runs: p pause, c continue, a or q end. Ctrl-C also ends it: outputs go to the safe state
    first, then the cleanup steps run; a second Ctrl-C skips them.

    Examples:

      rigctl run procedures/quick-check.yaml --operator Ada --serial-number HC-0042

      rigctl run procedures/quick-check.yaml --dry
    """
    from datetime import UTC, datetime

    from rigctl.cli.attended_run import attended, person_in_charge, report_end, say_warnings
    from rigctl.cli.options.identity import identified
    from rigctl.cli.options.serve import shown
    from rigctl.cli.plans import open_plan, read_assignments
    from rigctl.project import find_project
    from rigctl.runner.bench_access import bench_options, clock_for
    from rigctl.runner.launch import Launch, launch
    from rigctl.runner.operators.automatic_operator import AutomaticOperator

    plan = open_plan(procedure, rig, arg or ())
    runs = find_project().runs
    kind = backend or plan.rig.backend_named()
    given = {"serial_number": serial_number, "part": part, "operator": operator, "notes": notes}
    identity = identified(plan, given)
    say_warnings(plan.rig.warnings(datetime.now(UTC).date()))
    how = Launch(
        runs=runs,
        operator=AutomaticOperator(),
        backend=kind,
        options=bench_options(kind, plan.rig, port=port, seed=seed, recording=recording, runs=runs),
        clock=clock_for(speed, kind),
        person=person_in_charge(identity.operator),
        device=identity.device,
        arguments=read_assignments(arg or ()),
        seed=seed,
        dry=dry,
    )
    given_answers = read_assignments(answer or (), "--answer")
    with shown(wanted=serve):
        with attended(how, plan, given_answers, remote=answer_in_browser) as ready:
            result = launch(plan, ready)
        report_end(result, as_json=as_json)
