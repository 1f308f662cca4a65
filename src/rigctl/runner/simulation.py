"""A procedure on the simulated bench, from Python: the function behind `rigctl simulate`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from rigctl.argument_types import checks_argument_types
from rigctl.dataset import Run, open_run
from rigctl.errors import ExitCode, RigctlError
from rigctl.files.version_suffix import path_exists
from rigctl.notebook import one_line
from rigctl.plan import Plan
from rigctl.procedure import expand, load_procedure
from rigctl.project import find_project
from rigctl.rig import load_rig
from rigctl.runner.bench_access import clock_for
from rigctl.runner.launch import Launch, launch
from rigctl.runner.operators.automatic_operator import AutomaticOperator
from rigctl.runner.session import Observer, RunResult


@dataclass(frozen=True)
class Simulation:
    """How a simulated run ended (`result`), and what it recorded (`run`)."""

    result: RunResult
    run: Run

    def __repr__(self) -> str:
        """The run on one line."""
        return one_line(self, self.summary())

    def summary(self) -> str:
        """One line: the run, how it ended, how many records it has."""
        return self.result.summary()

    def _repr_html_(self) -> str:
        return self.run._repr_html_()


@checks_argument_types
def simulate(
    procedure: str | Path,
    *,
    rig: str | Path | None = None,
    arguments: Mapping[str, str] | None = None,
    plant: str | Path | None = None,
    effects: Sequence[str] = (),
    noise: bool | None = None,
    seed: int | None = None,
    speed: str = "max",
    faults: Sequence[str] = (),
    runs: str | Path | None = None,
    observer: Observer | None = None,
) -> Simulation:
    """Carry out a procedure on the simulated bench and record it like any other run.

    Parameters
    ----------
    procedure: the procedure file; looked for here, in the project, and among the shipped ones.
    rig: another rig file than the procedure names.
    arguments: of the procedure, written with units: ``{"temperatures": "20 degC, 60 degC"}``.
    plant: a model file that defines the simulated bench.
    effects: hidden effects, ``"piston_leakage:clearance=30 um"``.
    noise, seed: of the sensors; the rig file's own when None. One seed gives one set of samples.
    speed: ``max`` (virtual time), ``1x``, ``10x``.
    faults: which fault occurs when, ``"sensor_stuck:position@12 s"``.
    runs: the folder for the run; the project's by default.
    observer: called about ten times a second with the state of the run.

    Raises
    ------
    RigctlError
        a file, an argument, an effect or a fault is wrong; nothing was created.
    """
    project = find_project()
    read = load_procedure(_path_of(procedure))
    values = dict(arguments or {})
    plan = expand(read, load_rig(_path_of(rig) if rig is not None else read.rig_path), values)
    how = simulation_launch(
        plan,
        Path(runs) if runs is not None else project.runs,
        plant=_path_of(plant) if plant is not None else None,
        effects=effects,
        noise=noise,
        seed=seed,
        speed=speed,
        faults=faults,
        arguments=values,
        observer=observer,
    )
    result = launch(plan, how)
    if result.folder is None:
        raise RigctlError("nothing was recorded", hint=result.reason, exit_code=ExitCode.FAILED)
    return Simulation(result, open_run(result.folder))


def simulation_launch(
    plan: Plan,
    runs: Path,
    *,
    plant: Path | None = None,
    effects: Sequence[str] = (),
    noise: bool | None = None,
    seed: int | None = None,
    speed: str = "max",
    faults: Sequence[str] = (),
    arguments: Mapping[str, str] | None = None,
    observer: Observer | None = None,
    person: str = "",
    device: Mapping[str, str] | None = None,
) -> Launch:
    """The settings of `launch` for a private bench: no lock, and an operator who answers at once."""
    chosen: dict[str, object] = {
        "plant": str(plant.absolute()) if plant is not None else None,
        "effects": tuple(effects) or None,
        "noise": noise,
        "seed": seed,
        "faults": tuple(faults) or None,
    }
    return Launch(
        runs=runs,
        operator=AutomaticOperator(),
        backend="simulated",
        options={name: value for name, value in chosen.items() if value is not None},
        clock=clock_for(speed, "simulated"),
        person=person,
        device=device or {},
        arguments=arguments or {},
        seed=plan.rig.simulation.seed if seed is None else seed,
        observer=observer,
        exclusive=False,
    )


def _path_of(written: str | Path) -> Path:
    path = Path(written)
    return path if path_exists(path) else find_project().resolve(path)
