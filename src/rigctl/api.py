"""Functions of commands that use several packages: fit, run a bench, find runs.

For Python, what `rigctl model fit`, `run` and `runs list` are for the terminal. Other public names belong
to the package that does the work; these three need packages that may not import each other, and so stand
above them.

A script has no terminal on which a procedure could ask somebody. On a real bench `run` therefore requires
an operator, or answers stated beforehand; it answers by itself only where nothing real moves.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from rigctl.analysis.fitting import fit_to_data, read_runs, require_free_parameters
from rigctl.argument_types import checks_argument_types
from rigctl.backends.registry import backend_names
from rigctl.dataset import Run, RunSummary, list_runs
from rigctl.engine.one_thread import one_thread
from rigctl.errors import RigctlError, unknown_name
from rigctl.model.fit.fit import FitResult
from rigctl.model.model import Model
from rigctl.plan import Plan
from rigctl.procedure import expand, load_procedure
from rigctl.project import find_project
from rigctl.rig import load_rig
from rigctl.runner.bench_access import UNREAL, bench_options, clock_for
from rigctl.runner.launch import Launch, launch
from rigctl.runner.operators.automatic_operator import AutomaticOperator, scripted
from rigctl.runner.operators.operator import Operator
from rigctl.runner.session import Observer, RunResult


@checks_argument_types
@one_thread()
def fit(
    runs: Sequence[Run],
    model: Model,
    *,
    hold_out: str | None = None,
    only: str | None = None,
    on_progress: Callable[[str], None] = lambda _: None,
) -> FitResult:
    """Fit a model's free parameters to the usable records of `runs`; the model's file is not changed.

    ``min Σ ((f(θ) − y)/σ)²`` over the parameters θ that the model file marks as free, with their priors, and
    over the record-level parameters.

    Parameters
    ----------
    hold_out: a condition that selects the records to be held out of the fit, e.g. ``oil == 60 degC``.
    only: a condition that selects the records to be used; the noise is learned from all records.
    on_progress: called with a description of the current step.

    Raises
    ------
    RigctlError
        the runs do not belong to the model's bench, there are fewer values than parameters, or there are no
        free parameters.
    """
    if not runs:
        raise RigctlError("a fit needs a run")
    require_free_parameters(model)
    data = read_runs(model, runs, hold_out=hold_out, only=only, on_progress=on_progress)
    return fit_to_data(model, data, on_progress=on_progress)


@checks_argument_types
def run(
    procedure: str | Path,
    *,
    rig: str | Path | None = None,
    arguments: Mapping[str, str] | None = None,
    backend: str | None = None,
    port: str | None = None,
    operator: Operator | None = None,
    answers: Mapping[str, str] | None = None,
    person: str = "",
    device: Mapping[str, str] | None = None,
    seed: int | None = None,
    speed: str = "1x",
    dry: bool = False,
    runs: str | Path | None = None,
    observer: Observer | None = None,
) -> RunResult:
    """Carry out a procedure on the bench and record it, as `rigctl run` does; Ctrl-C ends it safely.

    Parameters
    ----------
    procedure, rig: files; by default the rig named in the procedure.
    arguments: of the procedure, written with units: ``{"supply": "30 bar"}``.
    backend: ``serial``, ``modbus``, ``visa``, ``opcua``, ``python``, ``emulated``, ``simulated``,
        ``replay``; the rig file names the default.
    port: a serial port or pyserial URL.
    operator: answers the procedure's questions.
    answers: instead of `operator`: values by name; confirmations are given immediately.
    person: the person in charge; kept with the run.
    device: facts about the device under test: ``serial_number``, ``part``, ``notes``; kept with the run.
    seed: of all random numbers, on a simulated bench.
    speed: ``1x``; on a bench that is not real also ``10x`` or ``max``.
    dry: arm and read, but move nothing.
    runs: the folder for the run; the project's by default.
    observer: called about ten times a second with the state of the run.

    Raises
    ------
    RigctlError
        a file, an argument or an option is wrong, there is no operator for a real bench, or it cannot be
        opened. The outcome of a run that has started is in the result.
    """
    read = load_procedure(Path(procedure))
    plan = expand(read, load_rig(Path(rig) if rig is not None else read.rig_path), dict(arguments or {}))
    kind = backend or plan.rig.backend_named()
    if kind not in backend_names():
        raise unknown_name("backend", kind, backend_names())
    folder = Path(runs) if runs is not None else find_project().runs
    return launch(
        plan,
        Launch(
            runs=folder,
            operator=operator or _answering(plan, kind, answers),
            backend=kind,
            options=bench_options(kind, plan.rig, port=port, seed=seed, runs=folder),
            clock=clock_for(speed, kind),
            person=person,
            device=dict(device or {}),
            arguments=dict(arguments or {}),
            seed=seed,
            observer=observer,
            dry=dry,
        ),
    )


def _answering(plan: Plan, backend: str, answers: Mapping[str, str] | None) -> Operator:
    if answers is not None:
        return scripted(plan, answers)
    if backend not in UNREAL:
        raise RigctlError(
            "somebody has to answer on a real bench",
            expected="an operator, or answers={…}, with which confirmations are given at once",
        )
    return AutomaticOperator()


@checks_argument_types
def find_runs(
    *,
    procedure: str | None = None,
    rig: str | None = None,
    status: str | None = None,
    where: str | None = None,
    runs: str | Path | None = None,
) -> list[RunSummary]:
    """The runs of a folder, oldest first; one small file of each is read, for many runs only changed ones.

    Parameters
    ----------
    procedure, rig: only those of this name.
    status: only those with this status: ``finished``, ``failed``, ``aborted``, ``interrupted``.
    where: only those that meet this condition, as `rigctl runs list --where`.
    runs: the folder, or the address in storage; the project's by default.

    Raises
    ------
    RigctlError
        the condition is wrong.
    """
    wanted = {"procedure": procedure, "rig": rig, "status": status}
    return [
        summary
        for summary in list_runs(runs, where=where)
        if all(value is None or getattr(summary, name) == value for name, value in wanted.items())
    ]
