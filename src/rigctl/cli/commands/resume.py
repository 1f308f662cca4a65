"""`rigctl resume`: resume an interrupted run."""

from __future__ import annotations

from typing import Annotated

import typer

from rigctl.cli.echo import echo
from rigctl.cli.options.as_json import Json
from rigctl.cli.options.driver import AllowDriverOption
from rigctl.cli.options.family import FamilyOption
from rigctl.cli.options.port import PortOption
from rigctl.wording import number_of


def resume(
    run: Annotated[str, typer.Argument(metavar="RUN", help="Id, start of an id, path, or 'latest'.")],
    port: PortOption = None,
    allow_driver: AllowDriverOption = None,
    operator: Annotated[str | None, typer.Option(help="Person now in charge.")] = None,
    speed: Annotated[
        str | None, typer.Option(help="max, 1x or 10x; by default as before.", show_default=False)
    ] = None,
    family: FamilyOption = None,
    *,
    as_json: Json = False,
) -> None:
    """Resume a run at its first incomplete record.

    The port, the speed, the seed and the hidden effects of a simulation are those of the original run.

    Procedure and rig file must not have changed. The set-points that the next record depends on are
    established again; complete records are kept, and an incomplete one is measured again under the next
    number.

    Example: rigctl resume latest
    """
    from rigctl.cli.attended_run import attended, person_in_charge, report_end
    from rigctl.dataset import find_run
    from rigctl.dataset.day_folders import runs_root
    from rigctl.runner.bench_access import bench_options, clock_for
    from rigctl.runner.launch import Launch
    from rigctl.runner.operators.automatic_operator import AutomaticOperator
    from rigctl.runner.resume import open_interrupted, relaunch

    if speed is not None:
        clock_for(speed, "simulated")  # whether it is one at all, before the run is opened
    before = open_interrupted(find_run(run))
    header = before.history.header
    kind = header.backend.get("kind", before.plan.rig.kind)
    given = bench_options(kind, before.plan.rig, port=port or header.options.get("port"), seed=header.seed)
    echo(f"{header.id}: {number_of(before.left, 'record')} left", err=True)
    how = Launch(
        runs=runs_root(before.folder),
        operator=AutomaticOperator(),
        backend=kind,
        options={**header.options, **given},
        clock=clock_for(speed or _speed_before(header.clock), kind),
        person=person_in_charge(operator or header.operator),
        device=header.device,
        arguments=header.arguments,
        seed=header.seed,
        exclusive=kind != "simulated",
    )
    with attended(how, before.plan, {}) as ready:
        result = relaunch(before, ready)
    report_end(result, as_json=as_json)


def _speed_before(clock: str) -> str:
    """The speed that a run's clock had, by the clock's name."""
    return {"virtual": "max", "real": "1x"}.get(clock, clock)
