"""Simulating records, with the sensitivities that a fit needs.

In: a compiled system and the excitation of each record. Out: `Trajectories`: states, outputs and, with
columns, the derivatives of the outputs by parameters, initial states and times of switches. They are the
exact derivatives of the computed steps, not differences of simulations; only the part of a system that an
FMU computes is differenced (`cascade`).

Records are independent, and run in threads of this process, which is possible because kernels release the
interpreter's lock: for other processes, arrays of tens of megabytes would be copied for work of
milliseconds. A record that fails is part of the result, up to the time of its failure.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from rigctl.engine import guards
from rigctl.engine.cascade import Columns, simulate_cascade
from rigctl.engine.compile import CompiledSystem, Integers, words_of
from rigctl.engine.excitation import Excitation, Floats, Ramps, check_fits
from rigctl.engine.failure import Failure, check_outputs, check_values, explain
from rigctl.engine.guards import Result, Workspace
from rigctl.engine.kernels import outcomes
from rigctl.engine.kernels import sizes as sizing
from rigctl.engine.source import Pattern
from rigctl.engine.splines import NO_SPLINES, SplineColumns
from rigctl.engine.threads import in_threads
from rigctl.engine.tolerance import DEFAULT, Tolerance
from rigctl.engine.trajectories import Statistics, Trajectories
from rigctl.errors import RigctlError, require_known


def simulate(
    compiled: CompiledSystem,
    excitations: Sequence[Excitation],
    *,
    columns: Sequence[str] = (),
    initial_columns: Sequence[str] = (),
    shift_columns: Sequence[str] = (),
    splines: SplineColumns = NO_SPLINES,
    tolerance: Tolerance = DEFAULT,
    workers: int | None = None,
) -> Trajectories:
    """Integrate every record; with columns, also the exact sensitivities of the outputs.

    Column c of the sensitivities is ``∂z/∂q_c`` for the parameters named in `columns`, then one for each of
    `splines` (named ``spline 0``, ``spline 1``, …), then ``∂z/∂y_c(0)`` for the states named in
    `initial_columns`, at fixed steps: the exact derivative of the computed steps. The last columns are by the
    quantities that shift switch times, ``Excitation.shifts``, named in `shift_columns`; they are zero for a
    record without them.

    Parameters
    ----------
    excitations: the records, which are integrated independently by `workers` threads, by default one for each
        core or the number in NUMBA_NUM_THREADS. The result does not depend on their number.
    columns, initial_columns: names of parameters and of states.
    splines: columns by the shapes of terms.
    tolerance: of each step.

    Returns
    -------
    Trajectories
        a record that could not be integrated ends where it failed, with the reason.

    Raises
    ------
    RigctlError
        a column is unknown, or a record does not fit the system.
    """
    # a part of the system is an FMU: its two other parts come back here
    if compiled.cascade is not None:
        return simulate_cascade(
            compiled,
            compiled.cascade,
            excitations,
            Columns(columns, initial_columns, shift_columns, splines),
            simulate,
        )
    plan = _plan(compiled, columns, splines, initial_columns, len(shift_columns), tolerance)
    for excitation in excitations:
        check_fits(excitation, compiled.system)
        if excitation.shifts is not None and excitation.shifts.shape[1] != len(shift_columns):
            raise RigctlError(
                f"record {excitation.name or '(unnamed)'} has {excitation.shifts.shape[1]} quantities that "
                "move its switches",
                expected=str(len(shift_columns)),
            )
    # the longest records first, by what they took last time, so that no thread ends alone with one
    known = compiled.steps
    expected = [known.get(excitation.name, 0) for excitation in excitations]
    results = in_threads(partial(_integrate, plan), excitations, workers, expected)
    known.update(
        (one.name, result.statistics.steps) for one, result in zip(excitations, results, strict=True)
    )
    return Trajectories(
        names=tuple(excitation.name for excitation in excitations),
        times=tuple(
            excitation.times[: len(result.states)]
            for excitation, result in zip(excitations, results, strict=True)
        ),
        states=tuple(result.states for result in results),
        outputs=tuple(result.outputs for result in results),
        sensitivities=tuple(result.sensitivities for result in results),
        failures=tuple(result.failure for result in results),
        state_names=compiled.system.state_names,
        output_names=compiled.system.output_names,
        columns=(
            *columns,
            *(f"spline {k}" for k in range(len(splines.columns))),
            *initial_columns,
            *shift_columns,
        ),
        stats=tuple(result.statistics for result in results),
    )


@dataclass(frozen=True)
class _Plan:
    """The data common to all records of one call."""

    compiled: CompiledSystem
    sizes: Integers
    tolerance: Floats
    initial_columns: Integers
    delayed: Integers
    rhs_active: Integers
    outputs_active: Integers
    delays_active: Integers
    #: arguments of the kernels: weights, knots, entries and scales of each packed ∂/∂q
    splines: tuple[Floats | Integers, ...]

    @cached_property
    def words(self) -> Integers:
        """The kernel's arguments from `initial_columns` on, the same for every record."""
        return words_of(
            self.initial_columns,
            self.delayed,
            self.rhs_active,
            self.outputs_active,
            self.delays_active,
            *self.splines,
        )


@dataclass(frozen=True)
class _Result:
    states: Floats
    outputs: Floats
    sensitivities: Floats
    failure: Failure | None
    statistics: Statistics

    @classmethod
    def nothing(cls, sizes: Integers, failure: Failure) -> _Result:
        """The result of a record that could not be started."""
        width = int(sizes[sizing.OUTPUTS_COUNT])
        return cls(
            np.empty((0, int(sizes[sizing.N]))),
            np.empty((0, width)),
            np.empty((0, width, int(sizes[sizing.COLUMNS]))),
            failure,
            Statistics(0, 0, 0),
        )


def _plan(
    compiled: CompiledSystem,
    columns: Sequence[str],
    splines: SplineColumns,
    initial_columns: Sequence[str],
    shifts: int,
    tolerance: Tolerance,
) -> _Plan:
    system, source = compiled.system, compiled.source
    # the kernel knows nothing of names: sizes, and for each packed ∂/∂q a table of its entries that the
    # columns want, so that derivatives by other parameters cost nothing but their evaluation
    chosen = _indices("parameter", columns, system.parameter_names)
    initial = _indices("state", initial_columns, system.state_names)
    patterns = (source.rhs_pattern, source.outputs_pattern, source.delays_pattern)
    active = [_active(pattern, chosen) for pattern in patterns]
    sizes = np.zeros(sizing.SIZES, dtype=np.int64)
    sizes[sizing.GUARD] = guards.width()
    sizes[sizing.N] = len(system.states)
    sizes[sizing.INPUTS] = len(system.inputs)
    sizes[sizing.OUTPUTS_COUNT] = len(system.outputs)
    sizes[sizing.DELAYS_COUNT] = len(system.delays)
    sizes[sizing.COLUMNS] = chosen.size + len(splines.columns) + initial.size + shifts
    sizes[sizing.SHIFTS] = shifts
    sizes[sizing.RHS_ENTRIES : sizing.DELAYS_ENTRIES + 1] = [len(pattern) for pattern in patterns]
    sizes[sizing.RHS_ACTIVE : sizing.DELAYS_ACTIVE + 1] = [len(entries) for entries in active]
    weighed = [splines.active(pattern, system, chosen.size) for pattern in patterns]
    sizes[sizing.SPLINE_ARGUMENTS : sizing.SPLINE_FUNCTIONS + 1] = len(splines.arguments), splines.functions
    sizes[sizing.RHS_SPLINES : sizing.DELAYS_SPLINES + 1] = [len(entries) for entries, _ in weighed]
    tables = (splines.weights(system), splines.knots(), *(table for pair in weighed for table in pair))
    return _Plan(
        compiled,
        sizes,
        tolerances(compiled, tolerance),
        initial,
        delayed_inputs(compiled),
        active[0],
        active[1],
        active[2],
        tables,
    )


def tolerances(compiled: CompiledSystem, tolerance: Tolerance) -> Floats:
    """The relative tolerance, then the absolute one of each state."""
    scales = [tolerance.absolute * state.scale for state in compiled.system.states]
    return np.array([tolerance.relative, *scales])


def delayed_inputs(compiled: CompiledSystem) -> Integers:
    """The index of each delay's input."""
    names = compiled.system.input_names
    return np.array([names.index(delay.input) for delay in compiled.system.delays], dtype=np.int64)


def _indices(kind: str, names: Sequence[str], known: Sequence[str]) -> Integers:
    require_known(f"{kind} to differentiate by", names, known)
    if len(set(names)) != len(names):
        repeated = [name for name in dict.fromkeys(names) if list(names).count(name) > 1]
        raise RigctlError(f"a {kind} is to be differentiated by twice", value=repeated[0])
    return np.array([known.index(name) for name in names], dtype=np.int64)


def _active(pattern: Pattern, columns: Integers) -> Integers:
    """(entries, 3) index, row and column of the entries of a packed ∂/∂q that the columns require."""
    column_of = {int(parameter): column for column, parameter in enumerate(columns)}
    entries = [
        (index, row, column_of[parameter])
        for index, (row, parameter) in enumerate(pattern)
        if parameter in column_of
    ]
    return np.array(entries, dtype=np.int64).reshape(-1, 3)


_NO_RAMPS = Ramps(np.empty(0, dtype=np.int64), np.empty(0), np.empty((0, 0)))


def _commands(excitation: Excitation, columns: int) -> tuple[Floats, Floats, Ramps]:
    """Inputs, derivatives of the switch times and ramps, in the form required by the kernel."""
    shifts = excitation.shifts
    if shifts is None:
        shifts = np.zeros((excitation.switch_times.size, columns))
        shifts.flags.writeable = False
    ramps = excitation.ramps
    if ramps is None or not ramps.knots.size:
        return excitation.inputs, shifts, _NO_RAMPS
    inputs = excitation.inputs.copy()
    inputs[:, ramps.inputs] = np.nan  # the kernel interprets NaN as no command
    inputs.flags.writeable = False
    return inputs, shifts, ramps


def _integrate(plan: _Plan, excitation: Excitation) -> _Result:
    bad = check_values(plan.compiled.system, excitation)
    if bad is not None:
        return _Result.nothing(plan.sizes, bad)
    # every command of every delayed input may be waiting at once
    sizes = plan.sizes.copy()
    sizes[sizing.CAPACITY] = plan.delayed.size * excitation.switch_times.size
    samples, columns = excitation.times.size, int(sizes[sizing.COLUMNS])
    width = int(sizes[sizing.OUTPUTS_COUNT])
    workspace = Workspace(sizes)
    results = (
        Result("states", (samples, excitation.initial.size)),
        Result("outputs", (samples, width)),
        Result("sensitivities", (samples, width, columns)),
    )
    states, outputs, sensitivities = (result.values for result in results)
    inputs, shifts, ramps = _commands(excitation, int(sizes[sizing.SHIFTS]))
    counters = np.zeros(outcomes.COUNTERS, dtype=np.int64)
    returned = np.zeros(3)
    # addresses and lengths in the order in which `kernels.record` unpacks them; the arrays are held here
    # while it runs
    given = words_of(
        plan.compiled.addresses,
        sizes,
        plan.tolerance,
        excitation.initial,
        excitation.parameters,
        excitation.switch_times,
        inputs,
        shifts,
        ramps.knots,
        ramps.values,
        ramps.inputs,
        excitation.times,
    )
    filled = words_of(
        workspace.floats, workspace.integers, states, outputs, sensitivities, counters, returned
    )
    plan.compiled.integrate_record(np.concatenate((given, plan.words, filled)))
    outcome, reached, done = int(returned[0]), float(returned[1]), int(returned[2])
    for checked in (workspace, *results):
        checked.check()
    # a record that fails keeps the samples before the failure: a reason and a time instead of NaN
    failure = None
    if outcome != outcomes.DONE:
        failure = explain(plan.compiled.system, outcome, reached, counters)
    else:
        failure = check_outputs(plan.compiled.system, excitation.times, outputs, sensitivities)
    if failure is not None:
        done = int(np.searchsorted(excitation.times[:done], failure.time))
    return _Result(states[:done], outputs[:done], sensitivities[:done], failure, Statistics.of(counters))
