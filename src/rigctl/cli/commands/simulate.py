"""`rigctl simulate`: carry out a procedure on the simulated bench."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rigctl.cli.options.as_json import Json
from rigctl.cli.options.family import FamilyOption
from rigctl.cli.options.identity import NotesOption, PartOption, SerialNumberOption
from rigctl.cli.options.procedure import ArgumentOption, RigOption
from rigctl.cli.options.serve import ServeOption


def simulate(
    procedure: Annotated[Path, typer.Argument(help="Procedure file.", show_default=False)],
    plant: Annotated[
        str | None,
        typer.Option(
            help="Model file to simulate as the true bench; by default the one named in the rig file."
        ),
    ] = None,
    effect: Annotated[
        list[str] | None,
        typer.Option("--with", metavar="EFFECT[:P=V,...]", help="Hidden effect of the bench; repeatable."),
    ] = None,
    noise: Annotated[bool | None, typer.Option("--noise/--no-noise", help="Sensor noise.")] = None,
    seed: Annotated[
        int | None,
        typer.Option(
            min=0, max=2**63 - 1, help="Seed for everything random; by default that of the rig file."
        ),
    ] = None,
    speed: Annotated[str, typer.Option(help="max (as fast as it computes), 1x, 10x.")] = "max",
    fault: Annotated[
        list[str] | None,
        typer.Option(metavar="KIND[:CHANNEL]@TIME", help="Fault to inject; repeatable."),
    ] = None,
    rig: RigOption = None,
    arg: ArgumentOption = None,
    operator: Annotated[str | None, typer.Option(help="Person in charge; kept with the run.")] = None,
    serial_number: SerialNumberOption = None,
    part: PartOption = None,
    notes: NotesOption = None,
    family: FamilyOption = None,
    *,
    serve: ServeOption = False,
    as_json: Json = False,
) -> None:
    """Carry out a procedure on the simulated bench and record it like any other run.

    The same seed gives the same samples. Faults: sensor_stuck, sensor_open, sensor_noisy,
    sensor_out_of_range (each with a channel), heater_stuck_on, valve_stuck, setpoint_never_reached,
    samples_stop, backend_lost.

    Examples:

      rigctl simulate procedures/campaign.yaml --seed 7

      rigctl simulate procedures/quick-check.yaml --with piston_leakage --fault "sensor_stuck:position@12 s"
    """
    from rigctl.cli.attended_run import attended, person_in_charge, report_end
    from rigctl.cli.options.identity import identified
    from rigctl.cli.options.serve import shown
    from rigctl.cli.plans import open_plan, read_assignments
    from rigctl.project import find_file, find_project
    from rigctl.runner.launch import launch
    from rigctl.runner.simulation import simulation_launch

    plan = open_plan(procedure, rig, arg or ())
    given = {"serial_number": serial_number, "part": part, "operator": operator, "notes": notes}
    identity = identified(plan, given, demanded=False)
    how = simulation_launch(
        plan,
        find_project().runs,
        plant=find_file(Path(plant)) if plant is not None else None,
        effects=effect or (),
        noise=noise,
        seed=seed,
        speed=speed,
        faults=fault or (),
        arguments=read_assignments(arg or ()),
        person=person_in_charge(identity.operator),
        device=identity.device,
    )
    with shown(wanted=serve):
        with attended(how, plan, {}) as ready:
            result = launch(plan, ready)
        report_end(result, as_json=as_json)
