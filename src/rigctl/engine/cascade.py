"""Records of a system of which a foreign program computes a part: an FMU, or a user's functions.

    u --(effects on commands)--> drives --(program)--> z --(effects on readings)--> outputs

The first and the last step are equations, integrated by the engine. The program is given the drives held
constant over each interval of a grid, at their means there. Effects on its parameters are functions of u,
too: what they add to one that can change during a simulation is held like a drive; to another one its mean
over the record is added. The grid has the samples, every command at the time at which it acts, and some
points after it. What is read of z, linear between the points, has exact derivatives. Derivatives through the
program are differences, central except at a value of 0, where only one side need exist, and of switches,
which lie at corners (`Change`). Each column is differenced with two steps, and with smaller and larger ones
until two agree; from then on with one, where that gives the same. A record that hardly moves keeps its
derivatives (`kept_derivatives`).
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from typing import Any, Final, TypeAlias

import numpy as np

from rigctl.engine.compile import Cascade, CompiledSystem
from rigctl.engine.differences import (
    MOVED,
    SHARE,
    Change,
    Step,
    grouped,
    interval_of,
    relative_difference,
    slope_of,
)
from rigctl.engine.excitation import Excitation, Floats, Ramps
from rigctl.engine.failure import Cause, Failure
from rigctl.engine.interval_means import GAUSS, Nodes
from rigctl.engine.kept_derivatives import Kept, Moves
from rigctl.engine.splines import SplineColumns
from rigctl.engine.symbols import Expr, derivative, evaluate, variables_of
from rigctl.engine.system import Foreign, System, after, before
from rigctl.engine.trajectories import OfEachRecord, Statistics, Trajectories
from rigctl.errors import ExitCode, RigctlError
from rigctl.foreign.pool import Job, Pool, pool_of

#: `rigctl.engine.simulate.simulate`, for the two parts in equations
Engine: TypeAlias = Callable[..., Trajectories]

#: pairs of steps that are tried, as shares of the usual one; two derivatives agree that differ by less than
#: `_AGREE`. Too large a step is off by its curvature, too small a one by the program's own tolerance: where
#: two agree neither is felt. Of a program with a coarse tolerance only large ones do.
_PAIRS: Final = ((1.0, 0.1), (0.1, 0.01), (10.0, 1.0), (100.0, 10.0))
_AGREE: Final = 0.02
#: steps that are tried alone
_SMALL: Final = (0.1, 0.01)
#: one step is enough where its derivative and that by two steps differ by less
_ALONE: Final = 0.005
#: the derivatives by two steps, neither of which can be used if they differ by more
_NO_DERIVATIVE: Final = 0.2
#: how often a step is corrected by what it does
_CORRECTIONS: Final = 8
#: a large step, as a share of the usual one
_LARGE: Final = 100.0
#: records on which steps are tried
_TRIED: Final = 2
#: points after a command at which a fast drive is followed, in sampling intervals
_AFTER: Final = tuple(0.5**k for k in range(8, 0, -1))
#: points before the first of them, between which only its mean over an interval is computed
_NEARER: Final = tuple(0.5**k for k in range(14, 8, -1))
#: what moves switches, as a column
_SWITCHES: Final = "switches"
#: two times closer than this share of a record are one
_SAME: Final = 1e-10


@dataclass(frozen=True)
class Columns:
    """The derivatives that are wanted: see `rigctl.engine.simulate.simulate`."""

    parameters: Sequence[str]
    initial: Sequence[str]
    shifts: Sequence[str]
    splines: SplineColumns

    @property
    def names(self) -> tuple[str, ...]:
        """Their names, in order."""
        of_splines = (f"spline {k}" for k in range(len(self.splines.columns)))
        return (*self.parameters, *of_splines, *self.initial, *self.shifts)


def simulate_cascade(
    compiled: CompiledSystem,
    cascade: Cascade,
    excitations: Sequence[Excitation],
    columns: Columns,
    engine: Engine,
) -> Trajectories:
    """Simulate records whose system has a foreign program.

    Raises
    ------
    RigctlError
        the program is not to be run, crashes or hangs.
    """
    foreign = compiled.system.foreign
    assert foreign is not None  # noqa: S101 - it has a cascade
    return _Cascade(compiled.system, foreign, cascade, columns, engine).simulate(excitations)


#: the kept derivatives of the last systems, and of how many there are any
_KEPT: list[dict[str, Kept]] = []
_MOST_KEPT: Final = 2
#: numbers in the kept derivatives of one system, 128 MiB
_MOST_NUMBERS: Final = 1 << 24


def _only_last(kept: dict[str, Kept]) -> None:
    """Forget the kept derivatives of systems before the last ones, since a diagnosis has dozens of them."""
    if not any(one is kept for one in _KEPT[:1]):
        _KEPT[:] = [kept, *(one for one in _KEPT if one is not kept)]
        for old in _KEPT[_MOST_KEPT:]:
            old.clear()
        del _KEPT[_MOST_KEPT:]


class _Later(OfEachRecord):
    """The derivatives of all records, made together when one is first used: a fit that rejects its step uses
    none.

    Parameters
    ----------
    lengths: how many samples of each record count.
    """

    def __init__(self, lengths: Sequence[int], make: Callable[[], list[Floats]]) -> None:
        self._lengths, self._make = lengths, make
        self._made: list[Floats] | None = None
        self._making = threading.Lock()  # records are read in several threads

    def __len__(self) -> int:
        return len(self._lengths)

    def of(self, record: int) -> Floats:
        """(samples, outputs, columns)."""
        with self._making:
            if self._made is None:
                self._made = [one[:n] for one, n in zip(self._make(), self._lengths, strict=True)]
        return self._made[record]


@dataclass(frozen=True)
class _Courses:
    """What the program computed in one record, on its grid; `reason` if it failed.

    Attributes
    ----------
    drives: (intervals, drives and added) what the program is given, and what is added to its parameters.
    commands: (intervals, inputs) those that act by then.
    """

    excitation: Excitation
    grid: Floats
    drives: Floats
    commands: Floats
    values: Floats
    reason: str

    @cached_property
    def at_samples(self) -> Floats:
        """(samples, responses) z."""
        return np.asarray(self.values[self.places])

    @cached_property
    def places(self) -> np.ndarray:
        """The samples' places in the grid."""
        right = np.clip(np.searchsorted(self.grid, self.excitation.times), 1, self.grid.size - 1)
        nearer = np.abs(self.grid[right - 1] - self.excitation.times) < np.abs(
            self.grid[right] - self.excitation.times
        )
        return np.asarray(right - nearer)


@dataclass(frozen=True)
class _Commanded:
    """What records are given, to find a step that changes it by as much as it should.

    Attributes
    ----------
    held: (drives and added) whether it has one value over a record, which is its mean.
    simulated: the courses of moved records at the nodes, with derivatives by these parameters.
    """

    excitations: Sequence[Excitation]
    grids: Sequence[Floats]
    nodes: Sequence[Nodes]
    held: np.ndarray
    simulated: Callable[..., Trajectories]

    def found(self, step: float, index: int, *columns: str) -> Trajectories:
        """The courses with a parameter moved by a step."""
        change = Change("parameter", index)
        return self.simulated([change.moved(one, step) for one in self.excitations], *columns)

    def magnitudes(self, courses: Sequence[Floats]) -> Floats:
        """(records, drives and added) the mean magnitude in each record."""
        each = []
        for nodes, course, grid in zip(self.nodes, courses, self.grids, strict=True):
            means, weights = nodes.means(course), np.diff(grid)
            whole = np.abs(np.average(means, axis=0, weights=weights))
            each.append(np.where(self.held, whole, np.average(np.abs(means), axis=0, weights=weights)))
        return np.array(each)


class _Cascade:
    def __init__(
        self, system: System, foreign: Foreign, cascade: Cascade, columns: Columns, engine: Engine
    ) -> None:
        self.system, self.foreign, self.cascade = system, foreign, cascade
        self.columns, self.engine = columns, engine
        self.pool: Pool = pool_of(foreign.program)
        self.index = {name: k for k, name in enumerate(system.parameter_names)}
        commands = cascade.commands.system
        given = [one.expr for one in commands.outputs]  # the drives, and what is added to parameters
        behind = [*given, *commands.rhs, *(delay.expr for delay in commands.delays)]
        self.of_commands = _names(behind) & set(self.index)
        self.of_delays = _names([delay.expr for delay in commands.delays]) & set(self.index)
        readings = cascade.readings.system
        read = _names([*readings.rhs, *(one.expr for one in readings.outputs)])
        self.of_readings = read & set(self.index)
        # parameters of a delay that move the only input whole; of several, others may switch at its times
        others = _names([*given, *commands.rhs])
        late = _names([delay.expr for delay in commands.delays])
        used = {*commands.input_names} & (others | late | read)
        single = len(used) == 1 and not late & {*commands.state_names}
        self.late_alone = self.of_delays - others if single else set()
        self.of_program = tuple(foreign.program.parameters)
        self.at_parameters = [self.index[name] for name in self.of_program]
        self.added = [self.of_program.index(one.parameter) for one in foreign.added]
        self.tunable = [self.of_program.index(name) for name in foreign.program.tunable]
        self.at_responses = [system.state_names.index(name) for name in foreign.responses]
        self.settable = set(foreign.program.settable)
        #: of columns whose steps have just been sized, the records on which they are tried
        self.tried: dict[str, list[int]] = {}

    def simulate(self, excitations: Sequence[Excitation]) -> Trajectories:
        # the drives, the program, and what is read of it, with the exact derivatives of the readings
        courses = self._run(excitations)
        wanted = [name for name in self.columns.parameters if name in self.of_readings]
        states = [
            name
            for name in self.columns.initial
            if name in self.cascade.readings.system.state_names and name not in self.foreign.responses
        ]
        read = self._read(courses, columns=wanted, initial_columns=states)
        failed = [self._failure(one) for one in courses]
        later = partial(self._derivatives, excitations, courses, read, failed)
        simulated = self._trajectories(excitations, courses, read, later, failed)
        # Steps are chosen on the first records of the first part of a problem: at once, and not when one of
        # several threads happens to be the first that uses its derivatives.
        moving = [_SWITCHES] if self.late_alone & {*self.columns.parameters} or self.columns.shifts else []
        if excitations and not {*self._through(), *moving} <= {*self.cascade.steps}:
            simulated.sensitivities[0]
        return simulated

    def _derivatives(
        self,
        excitations: Sequence[Excitation],
        courses: Sequence[_Courses],
        read: Trajectories,
        failed: Sequence[Failure | None],
    ) -> list[Floats]:
        """(samples, outputs, columns) of each record; 0 for one that failed."""
        through = [np.zeros((*one.shape, len(self.columns.names))) for one in read.outputs]
        slopes = [np.zeros((*one.shape, len(self.columns.names))) for one in read.outputs]
        good = [k for k, one in enumerate(failed) if one is None and read.failures[k] is None]
        places = {name: k for k, name in enumerate(self.columns.names)}
        for k in good:
            for at, name in enumerate(read.columns):
                slopes[k][:, :, places[name]] = read.sensitivities[k][:, :, at]
        # those through the program, where a record has moved since they were made last
        kept = self.cascade.kept
        new = []
        for k in good:
            record, known = excitations[k], kept.get(excitations[k].name)
            same = known is not None and known.columns == self.columns.names
            if known is not None and same and known.hold(record, read.outputs[k], self._moves(record)):
                through[k] = known.through
            else:
                new.append(k)
        self._splines(excitations, new, courses, through, places)
        self._differences(excitations, new, courses, read, through, places)
        # added to the others: a parameter may act on both sides of it
        for k in good:
            slopes[k] += through[k]
        if not self.columns.splines.columns:
            _only_last(kept)
            for k in new:
                self._keep(Kept(self.columns.names, excitations[k], read.outputs[k], slopes[k], through[k]))
        return slopes

    def _keep(self, made: Kept) -> None:
        """Keep the derivatives of a record in the place of those by other columns, which no fit has any more;
        none beyond `_MOST_NUMBERS`."""
        kept = self.cascade.kept
        kept.pop(made.excitation.name, None)
        if sum(one.numbers for one in list(kept.values())) + made.numbers <= _MOST_NUMBERS:
            kept[made.excitation.name] = made

    def _moves(self, excitation: Excitation) -> Moves:
        columns, places = self.columns, {name: k for k, name in enumerate(self.columns.names)}
        states = self.system.state_names
        initial = [states.index(name) for name in columns.initial]
        return Moves(
            len(places),
            [(self.index[name], places[name]) for name in columns.parameters],
            [(index, places[name]) for index, name in zip(initial, columns.initial, strict=True)],
            [self.index[name] for name in columns.shifts if name in self.index],
            np.array([self.system.states[index].scale for index in initial]),
            len(places) - len(columns.shifts),
            interval_of(excitation),
        )

    def _trajectories(
        self,
        excitations: Sequence[Excitation],
        courses: Sequence[_Courses],
        read: Trajectories,
        later: Callable[[], list[Floats]],
        failed: Sequence[Failure | None],
    ) -> Trajectories:
        failures = [mine or theirs for mine, theirs in zip(failed, read.failures, strict=True)]
        done = [
            len(outputs)
            if failure is None
            else min(len(outputs), int(np.searchsorted(one.times, failure.time)))
            for one, outputs, failure in zip(excitations, read.outputs, failures, strict=True)
        ]
        return Trajectories(
            names=tuple(one.name for one in excitations),
            times=tuple(one.times[:n] for one, n in zip(excitations, done, strict=True)),
            states=tuple(self._states(k, read, excitations)[:n] for k, n in enumerate(done)),
            outputs=tuple(one[:n] for one, n in zip(read.outputs, done, strict=True)),
            sensitivities=_Later(done, later),
            failures=tuple(failures),
            state_names=self.system.state_names,
            output_names=self.system.output_names,
            columns=self.columns.names,
            stats=tuple(Statistics(one.grid.size, 0, 0) for one in courses),
        )

    def _states(self, index: int, read: Trajectories, excitations: Sequence[Excitation]) -> Floats:
        """(samples, states); those on which no reading depends are left at their start."""
        known = read.states[index]
        states = np.tile(excitations[index].initial, (len(known), 1))
        for at, name in enumerate(read.state_names):
            states[:, self.system.state_names.index(name)] = known[:, at]
        return states

    def _failure(self, courses: _Courses) -> Failure | None:
        if not courses.reason:
            return None
        finite = np.isfinite(courses.values).all(axis=1)
        at = float(courses.grid[int(np.argmin(finite))] if not finite.all() else courses.grid[-1])
        return Failure(Cause.EQUATIONS, courses.reason, at)

    # what the program is given, and what it answers

    def _run(
        self,
        excitations: Sequence[Excitation],
        nudges: Sequence[Floats | None] = (),
        same: Sequence[_Courses | None] = (),
    ) -> list[_Courses]:
        """The courses of records.

        Parameters
        ----------
        nudges: what is added to the drives of each.
        same: a record that has the same grid and drives.
        """
        # a change that leaves the drives as they are, of a parameter of the program or its initial state,
        # takes grid and drives of the record: only the program is run again
        known = list(same) or [None] * len(excitations)
        new = [one for one, like in zip(excitations, known, strict=True) if like is None]
        late = self._late(new)
        grids = [self._grid(one, _acting(one, each)) for one, each in zip(new, late, strict=True)]
        commands = [self._held(*one) for one in zip(new, grids, late, strict=True)]
        fresh = iter(zip(grids, self._drives(new, grids), commands, strict=True))
        given = [next(fresh) if like is None else (like.grid, like.drives, like.commands) for like in known]
        if nudges:
            given = [
                (grid, drives if nudge is None else drives + nudge, held)
                for (grid, drives, held), nudge in zip(given, nudges, strict=True)
            ]
        jobs = [
            self._job(one, grid, drives) for one, (grid, drives, _) in zip(excitations, given, strict=True)
        ]
        return [
            _Courses(one, grid, drives, held, result.values, result.reason)
            for one, (grid, drives, held), result in zip(excitations, given, self.pool.run(jobs), strict=True)
        ]

    def _job(self, excitation: Excitation, grid: Floats, drives: Floats) -> Job:
        """The simulation of a record.

        Parameters
        ----------
        drives: (intervals, drives and added).
        """
        given, added = np.hsplit(drives, [len(self.foreign.drives)])
        parameters = excitation.parameters[self.at_parameters]
        changing = np.tile(parameters[self.tunable], (len(given), 1))
        # within the parameter's bounds: no drift makes a friction negative
        for place, one, term in zip(self.added, self.foreign.added, added.T, strict=True):
            if place in self.tunable:
                column = self.tunable.index(place)
                changing[:, column] = np.clip(changing[:, column] + term, one.low, one.high)
            else:
                mean = float(np.average(term, weights=np.diff(grid)))
                parameters[place] = min(max(parameters[place] + mean, one.low), one.high)
        # a program whose parameters are constant is simulated as without effects on them
        if (changing != parameters[self.tunable]).any():
            given = np.hstack([given, changing])
        return Job(excitation.name, grid, given, parameters, excitation.initial[self.at_responses])

    def _drives(self, excitations: Sequence[Excitation], grids: Sequence[Floats]) -> list[Floats]:
        """(intervals, drives and added) of each record: the means over each interval."""
        if not excitations:
            return []
        acting = self._acting(excitations) if self.cascade.commands.system.states else grids
        nodes = [self._nodes(one, grid, at) for one, grid, at in zip(excitations, grids, acting, strict=True)]
        found = self.engine(
            self.cascade.commands,
            [self._command(one, each.times) for one, each in zip(excitations, nodes, strict=True)],
        ).require()
        return [each.means(outputs) for each, outputs in zip(nodes, found.outputs, strict=True)]

    def _nodes(self, excitation: Excitation, grid: Floats, acting: Floats) -> Nodes:
        """Where the drives are evaluated for their means: in the middle of an interval, where they are
        constant or a line; else at several points, nearer to each other just after a command."""
        if not self.cascade.commands.system.states:
            return Nodes.of(grid, grid, (0.5,), (1.0,))
        near = np.concatenate([acting + share * interval_of(excitation) for share in _NEARER])
        edges = np.union1d(grid, near[(near > grid[0]) & (near < grid[-1])])
        return Nodes.of(grid, edges, *GAUSS)

    def _command(self, excitation: Excitation, times: Floats) -> Excitation:
        system = self.cascade.commands.system
        return replace(excitation, times=times, initial=self._initial(excitation, system), shifts=None)

    def _initial(self, excitation: Excitation, system: System) -> Floats:
        return np.array(
            [excitation.initial[self.system.state_names.index(name)] for name in system.state_names]
        )

    def _acting(self, excitations: Sequence[Excitation]) -> list[Floats]:
        """The times at which commands act in each record: those of the switches, and with their delays."""
        return [_acting(one, each) for one, each in zip(excitations, self._late(excitations), strict=True)]

    def _late(self, excitations: Sequence[Excitation]) -> list[Floats]:
        """(switches, delays) when a delayed input acts; NaN where it is not switched."""
        system = self.cascade.commands.system
        if not system.delays:
            return [np.empty((one.switch_times.size, 0)) for one in excitations]
        moving = bool(_names([delay.expr for delay in system.delays]) & set(system.state_names))
        states: Sequence[Floats] = [
            np.tile(self._initial(one, system), (one.switch_times.size, 1)) for one in excitations
        ]
        if moving:
            at = [self._command(one, one.switch_times) for one in excitations]
            states = self.engine(self.cascade.commands, at).require().states
        return [self._delayed(one, each) for one, each in zip(excitations, states, strict=True)]

    def _of_switches(self, excitation: Excitation) -> Floats:
        """(switches, 1 + delays) when what each switches acts: inputs without a delay, and each with one."""
        system = self.cascade.commands.system
        (late,) = self._late([excitation])
        delayed = [system.input_names.index(delay.input) for delay in system.delays]
        changed = np.diff(np.delete(excitation.inputs, delayed, axis=1), axis=0).any(axis=1)
        at_once = np.where(np.concatenate([[True], changed]), excitation.switch_times, np.nan)
        return np.column_stack([at_once, late])

    def _delayed(self, excitation: Excitation, states: Floats) -> Floats:
        system = self.cascade.commands.system
        inputs = excitation.inputs
        known: dict[str, Any] = dict(zip(system.parameter_names, excitation.parameters.tolist(), strict=True))
        late = np.full((excitation.switch_times.size, len(system.delays)), np.nan)
        for column, delay in enumerate(system.delays):
            k = system.input_names.index(delay.input)
            for at in np.flatnonzero(np.diff(inputs[:, k])) + 1:
                known |= dict(zip(system.state_names, states[at].tolist(), strict=True))
                known[before(delay.input)], known[after(delay.input)] = inputs[at - 1, k], inputs[at, k]
                late[at, column] = excitation.switch_times[at] + max(evaluate(delay.expr, known), 0.0)
        return late

    def _held(self, excitation: Excitation, grid: Floats, late: Floats) -> Floats:
        """(intervals, inputs) the commands that act in each interval of the grid."""
        begins = grid[:-1] + _SAME * (grid[-1] - grid[0])
        at = np.searchsorted(excitation.switch_times, begins, side="right") - 1
        held: Floats = excitation.inputs[np.clip(at, 0, None)]
        system = self.cascade.commands.system
        for delay, times in zip(system.delays, late.T, strict=True):
            acting = [0]
            for switch in np.flatnonzero(np.isfinite(times)):
                # one that acts earlier than those before it takes their place
                while len(acting) > 1 and times[acting[-1]] >= times[switch]:
                    acting.pop()
                acting.append(int(switch))
            k = system.input_names.index(delay.input)
            place = np.searchsorted(times[acting[1:]], begins, side="right")
            held[:, k] = excitation.inputs[np.array(acting)[place], k]
        return held

    def _grid(self, excitation: Excitation, acting: Floats) -> Floats:
        """The points of a record at which the program is given its drives."""
        begin = excitation.switch_times[0]
        end = max(excitation.times[-1] if excitation.times.size else begin, begin)
        step = interval_of(excitation)
        # the drives are held over an interval of this grid, so that each command acts exactly at its time;
        # where the effects on commands have states a drive also moves between them, fastest just after one
        points = [np.array([begin]), excitation.times, acting]
        if self.cascade.commands.system.states:
            points += [acting + share * step for share in _AFTER]
        if excitation.ramps is not None:
            points.append(excitation.ramps.knots)
        grid = np.unique(np.concatenate(points))
        grid = grid[(grid >= begin) & (grid <= end)]
        grid = grid[np.concatenate([[True], np.diff(grid) > _SAME * max(end - begin, step)])]
        return grid if grid.size > 1 else np.array([begin, begin + step])

    # what is read of it

    def _read(self, courses: Sequence[_Courses], **how: Any) -> Trajectories:
        """The readings of what the program computed."""
        return self.engine(self.cascade.readings, [self._reading(one) for one in courses], **how)

    def _reading(self, courses: _Courses) -> Excitation:
        one, system = courses.excitation, self.cascade.readings.system
        # z as states of the readings' equations, whose rates are the inputs: constant over an interval, which
        # is a line between the points. Differences of z are then differences of readings
        values = np.nan_to_num(courses.values)
        rates = np.diff(values, axis=0) / np.diff(courses.grid)[:, None]
        initial = self._initial(one, system)
        for k, name in enumerate(self.foreign.responses):
            initial[system.state_names.index(name)] = values[0, k]
        ramps = one.ramps
        return Excitation(
            one.times,
            courses.grid[:-1],
            np.hstack([courses.commands, rates]),
            initial,
            one.parameters,
            one.name,
            ramps=None if ramps is None else Ramps(ramps.inputs, ramps.knots, ramps.values),
        )

    # derivatives through the program

    def _differences(
        self,
        excitations: Sequence[Excitation],
        good: Sequence[int],
        courses: Sequence[_Courses],
        read: Trajectories,
        slopes: Sequence[Floats],
        places: dict[str, int],
    ) -> None:
        """Add the derivatives through the program to `slopes`."""
        if not good:
            return
        late = [name for name in self.columns.parameters if name in self.late_alone]
        through = self._through()
        self._size_steps([name for name in through if self._commands(name)], excitations, good)
        changes = {name: self._change(name, excitations[good[0]]) for name in through}
        pieces = [(name, changes[name], k) for name in through for k in good]
        # Whatever moves switches has the derivatives by their times: what moves some of them alike moves a
        # group. A delay of all commands is then exactly what the logger's delays are together.
        moving = [*late, *self.columns.shifts]
        groups = {k: grouped(self._moving(excitations[k], late)) for k in good} if moving else {}
        moved = [
            replace(one, shifts=groups[k][0]) if k in groups else one for k, one in enumerate(excitations)
        ]
        acting = {k: self._of_switches(excitations[k]) for k in groups}
        pieces += [
            (_SWITCHES, Change("shift", group, acting=acting[k]), k)
            for k, (moves, _) in groups.items()
            for group in range(moves.shape[1])
        ]
        found = self._each_slope(pieces, moved, courses, read)
        at = [places[name] for name in moving]
        for (name, change, k), slope in zip(pieces, found, strict=True):
            if name == _SWITCHES:
                slopes[k][:, :, at] += slope[:, :, None] * groups[k][1][change.index]
            elif np.isfinite(slope).all() or not self._commands(name):
                # an effect with which the program fails at the least step shows nothing, and is not tested
                slopes[k][:, :, places[name]] += slope

    def _through(self) -> list[str]:
        """The columns that act through the program, but for what moves switches."""
        through = [
            *(n for n in self.columns.parameters if n in self.of_commands or n in self.of_program),
            *(n for n in self.columns.initial if n in self.settable),
        ]
        return [name for name in through if name not in self.late_alone]

    def _each_slope(
        self,
        pieces: Sequence[tuple[str, Change, int]],
        excitations: Sequence[Excitation],
        courses: Sequence[_Courses],
        read: Trajectories,
    ) -> list[Floats]:
        """(samples, outputs) the derivative of each piece: a column, its change, a record."""
        # the step of a column is chosen once for each model, on the first records in which it moves
        # something, or on those in which it changes what the program is given most (decision 197)
        steps = self.cascade.steps
        for name in dict.fromkeys(name for name, _, _ in pieces):
            if name not in steps:
                mine = [(change, k) for each, change, k in pieces if each == name]
                some = self.tried.get(name) or list(dict.fromkeys(k for _, k in mine))[:_TRIED]
                self._try_steps(name, [one for one in mine if one[1] in some], excitations, courses, read)
        return self._slopes(
            [(change, steps[name], k) for name, change, k in pieces], excitations, courses, read
        )

    def _moving(self, excitation: Excitation, late: Sequence[str]) -> Floats:
        """(switches, k) by how much each switch acts later by each parameter of a delay, and by what shifts
        it."""
        system = self.cascade.commands.system
        known: dict[str, Any] = dict(zip(system.parameter_names, excitation.parameters.tolist(), strict=True))
        moved = np.zeros((excitation.switch_times.size, len(late)))
        inputs = excitation.inputs
        for delay in system.delays if late else ():
            k = system.input_names.index(delay.input)
            variables = {one.name: one for one in variables_of(delay.expr)}
            slopes = [derivative(delay.expr, variables[name]) if name in variables else None for name in late]
            for at in np.flatnonzero(np.diff(inputs[:, k])) + 1:
                known[before(delay.input)], known[after(delay.input)] = inputs[at - 1, k], inputs[at, k]
                # a negative delay is none, and does not move
                if evaluate(delay.expr, known) >= 0.0:
                    moved[at] = [0.0 if slope is None else evaluate(slope, known) for slope in slopes]
        shifts = excitation.shifts
        return moved if shifts is None else np.hstack([moved, shifts])

    def _try_steps(
        self,
        name: str,
        pieces: Sequence[tuple[Change, int]],
        excitations: Sequence[Excitation],
        courses: Sequence[_Courses],
        read: Trajectories,
    ) -> None:
        """Choose the steps of a column: the larger of the first pair that agree, else of the best pair; and
        one alone, where its derivative is the same."""

        def found(step: Step) -> Floats:
            made = self._slopes([(change, step, k) for change, k in pieces], excitations, courses, read)
            return np.concatenate([one.ravel() for one in made])

        by = cache(lambda share: found(Step(share)))
        best = (np.inf, _PAIRS[0])
        for larger, smaller in _PAIRS:
            best = min(best, (relative_difference(by(smaller), by(larger)), (larger, smaller)))
            if best[0] < _AGREE:
                break
        apart, (larger, smaller) = best
        if name in self.of_program:
            at = [courses[k] for _, k in pieces]
            self._require_derivative(name, pieces[0][0], (apart, larger), by(1.0), at)
        # Where these records do not show the column, two steps agree about nothing: others may show it.
        seen = by(1.0).any()
        chosen = Step(larger, apart=apart) if seen else Step(1.0)
        for share in _SMALL if seen and apart < _AGREE else ():
            one = found(Step(share, alone=True))
            if relative_difference(one, by(smaller)) < _ALONE:
                chosen = Step(share, alone=True, apart=apart)
                break
        self.cascade.steps[name] = chosen

    def _require_derivative(
        self,
        name: str,
        change: Change,
        best: tuple[float, float],
        slope: Floats,
        courses: Sequence[_Courses],
    ) -> None:
        """Refuse a parameter of the program by which its outputs have no derivative.

        Parameters
        ----------
        best: by how much its derivatives by two steps differ at least, and the share of the larger step.
        slope: the derivative by the usual step.

        Raises
        ------
        RigctlError
            the two differ by too much, or both are 0 and a much larger step changes the outputs.
        """
        apart, share = best
        if not slope.any():
            own = [one.excitation for one in courses]
            far = self._run([change.moved(one, change.steps(one, _LARGE)[0]) for one in own])
            if all(
                new.reason or np.array_equal(new.at_samples, old.at_samples)
                for new, old in zip(far, courses, strict=True)
            ):
                return
            what = f"small changes of it change nothing, and one of {100.0 * _LARGE * SHARE:.0f} % does"
        elif _NO_DERIVATIVE < apart < np.inf:
            step = 100.0 * share * SHARE
            what = (
                f"differences by {step:.2g} % and {step / 10.0:.2g} % of it are {100.0 * apart:.0f} % apart"
            )
        else:
            return
        program = self.foreign.program
        raise RigctlError(
            f"the outputs of {program.name} have no derivative by {name}: {what}",
            where=program.location,
            hint="Fix it at its value, or make what depends on it change without jumps",
            exit_code=ExitCode.FAILED,
        )

    def _slopes(
        self,
        pieces: Sequence[tuple[Change, Step, int]],
        excitations: Sequence[Excitation],
        courses: Sequence[_Courses],
        read: Trajectories,
    ) -> list[Floats]:
        """(samples, outputs) the derivative of each piece: a change, its step, a record."""
        moved: list[Excitation] = []
        same: list[_Courses | None] = []
        ends: list[tuple[int, float]] = []  # of each: piece, step
        for at, (change, chosen, k) in enumerate(pieces):
            both = change.steps(excitations[k], chosen.share)
            for step in both[1:] if chosen.alone else both:
                moved.append(change.moved(excitations[k], step))
                same.append(courses[k] if change.keeps_drives else None)
                ends.append((at, step))
        # all records and columns in one call, for which the pool of processes has work at once
        runs = self._run(moved, same=same)
        outputs = self._moved_outputs(runs, [pieces[at][2] for at, _ in ends], courses, read)
        of_piece: dict[int, list[tuple[float, Floats]]] = {}
        for (at, step), each in zip(ends, outputs, strict=True):
            of_piece.setdefault(at, []).append((step, each))
        slopes = [slope_of(of_piece[at]) for at in range(len(pieces))]
        # one step alone may lead where the program fails: then the other one counts
        alone = [k for k, (_, chosen, _) in enumerate(pieces) if chosen.alone]
        lost = [k for k in alone if not np.isfinite(slopes[k]).all()]
        if lost:
            again = [(pieces[k][0], Step(pieces[k][1].share), pieces[k][2]) for k in lost]
            for k, slope in zip(lost, self._slopes(again, excitations, courses, read), strict=True):
                slopes[k] = slope
        return slopes

    def _moved_outputs(
        self,
        runs: Sequence[_Courses],
        records: Sequence[int],
        courses: Sequence[_Courses],
        read: Trajectories,
    ) -> list[Floats]:
        """(samples, outputs) each minus the record's own outputs."""
        # an output that is the program's own needs no integration of the readings
        where = self._passed(read, records)
        if where is not None:
            return [
                _or_nan(run, (run.at_samples - courses[k].at_samples)[:, where])
                for run, k in zip(runs, records, strict=True)
            ]
        # derivatives through the program alone: the equations of the readings keep their parameters
        own = [
            replace(run, excitation=replace(run.excitation, parameters=courses[k].excitation.parameters))
            for run, k in zip(runs, records, strict=True)
        ]
        found = self._read(own)
        return [
            _or_nan(run, outputs - read.outputs[k])
            if len(outputs) == len(read.outputs[k])
            else np.full_like(read.outputs[k], np.nan)
            for run, outputs, k in zip(runs, found.outputs, records, strict=True)
        ]

    def _passed(self, read: Trajectories, records: Sequence[int]) -> list[int] | None:
        """For each output the program's that it equals; None if effects change one of them."""
        names, where = list(read.state_names), []
        for output in range(len(self.system.outputs)):
            equal = [
                k
                for k, response in enumerate(self.foreign.responses)
                if all(
                    np.array_equal(read.outputs[r][:, output], read.states[r][:, names.index(response)])
                    for r in set(records)
                )
            ]
            expr = self.system.outputs[output].expr
            equal = [k for k in equal if self.foreign.responses[k] in _names([expr])]
            if not equal:
                return None
            where.append(equal[0])
        return where

    def _commands(self, name: str) -> bool:
        """Whether it acts on what the program is given alone, otherwise than by the times of commands."""
        return name not in self.settable and name not in self.of_program and name not in self.of_delays

    def _change(self, name: str, excitation: Excitation) -> Change:
        """How a column is differenced."""
        if name in self.settable:
            k = self.system.state_names.index(name)
            return Change("initial", k, self.system.states[k].scale, keeps_drives=True)
        k = self.index[name]
        if name in self.of_program:
            kept = name not in self.of_commands
            return Change("parameter", k, SHARE * self.foreign.program.sizes[name], keeps_drives=kept)
        if name in self.of_delays:
            return Change("parameter", k, MOVED * interval_of(excitation))
        return Change("parameter", k, self.cascade.sizes[name])

    def _size_steps(
        self, names: Sequence[str], excitations: Sequence[Excitation], good: Sequence[int]
    ) -> None:
        """Choose the usual steps of columns that have none yet, and the records on which steps are tried."""
        new = [name for name in names if name not in self.cascade.sizes]
        if not new:
            return
        commanded = self._commanded([excitations[k] for k in good])
        for name in new:
            step, shown = self._command_step(name, commanded)
            self.cascade.sizes[name] = step
            most = np.argsort(-shown, kind="stable")[:_TRIED]
            self.tried[name] = [good[k] for k in most.tolist()]

    def _command_step(self, name: str, commanded: _Commanded) -> tuple[float, Floats]:
        """The step of a parameter that acts on the drives, or on the program's parameters, and how much it
        changes in each record.

        It follows from their derivatives, and is corrected until it does what it should. The derivative by a
        lag at 0, for example, is a spike after each switch, which may lie between two nodes.
        """
        here = commanded.found(0.0, self.index[name], name)
        scale = commanded.magnitudes(here.outputs).max(axis=0)
        slopes = commanded.magnitudes([here.sensitivities[k][:, :, 0] for k in range(len(here.outputs))])
        step = self._step(slopes.max(axis=0), scale) or SHARE
        for _ in range(_CORRECTIONS):
            there = commanded.found(step, self.index[name])
            moved = [after - before for after, before in zip(there.outputs, here.outputs, strict=True)]
            slopes = commanded.magnitudes(moved) / step
            right = self._step(slopes.max(axis=0), scale)
            if not right or 0.5 * step <= right <= 2.0 * step:
                break
            step = right
        # each drive in units of what it changes at most
        return step, np.sum(slopes / np.maximum(slopes.max(axis=0), np.finfo(float).tiny), axis=1)

    def _commanded(self, excitations: Sequence[Excitation]) -> _Commanded:
        acting = self._acting(excitations)
        grids = [self._grid(one, at) for one, at in zip(excitations, acting, strict=True)]
        nodes = [self._nodes(one, grid, at) for one, grid, at in zip(excitations, grids, acting, strict=True)]
        held = [*[False] * len(self.foreign.drives), *(place not in self.tunable for place in self.added)]

        def found(records: Sequence[Excitation], *columns: str) -> Trajectories:
            at = [self._command(one, each.times) for one, each in zip(records, nodes, strict=True)]
            return self.engine(self.cascade.commands, at, columns=columns).require()

        return _Commanded(excitations, grids, nodes, np.array(held), found)

    def _step(self, changed: Floats, scale: Floats) -> float:
        """The largest step that changes no drive by more than a share of its mean magnitude, and none of the
        program's parameters by more than that share of a change of it that matters; 0 if it changes none.

        Parameters
        ----------
        changed, scale: (drives and added) mean magnitudes of the derivatives, and of the values.
        """
        # each by its own, as they have units of their own: an air temperature in K would dwarf any power
        matters = [one or 1.0 for one in scale[: len(self.foreign.drives)].tolist()]
        matters += [self.foreign.program.sizes[self.of_program[place]] for place in self.added]
        steps = [
            SHARE * size / slope for size, slope in zip(matters, changed.tolist(), strict=True) if slope > 0.0
        ]
        return min(steps, default=0.0)

    def _splines(
        self,
        excitations: Sequence[Excitation],
        good: Sequence[int],
        courses: Sequence[_Courses],
        slopes: Sequence[Floats],
        places: dict[str, int],
    ) -> None:
        """Columns for the shapes of terms: exact at the readings, differences at the commands."""
        splines = self.columns.splines
        if not splines.columns or not good:
            return
        some = [courses[k] for k in good]
        names = {name for one in splines.columns for name in one.parameters}
        arguments = {name for one in splines.arguments for name in one.weights}
        system = self.cascade.readings.system
        first = places["spline 0"]
        if names & self.of_readings and arguments <= {*system.state_names, *system.input_names}:
            read = self._read(some, splines=splines)
            for at, k in enumerate(good):
                slopes[k][:, :, first : first + len(splines.columns)] += read.sensitivities[at]
        commands = self.cascade.commands.system
        if not (names & self.of_commands and arguments <= {*commands.state_names, *commands.input_names}):
            return
        moved: list[Excitation] = []
        nudges: list[Floats | None] = []
        steps: list[float] = []
        for k in good:
            one = excitations[k]
            (acting,) = self._acting([one])
            nodes = self._nodes(one, courses[k].grid, acting)
            command = self._command(one, nodes.times)
            found = self.engine(self.cascade.commands, [command], splines=splines).require()
            means = nodes.means(found.sensitivities[0])
            for column in range(len(splines.columns)):
                slope = means[:, :, column]
                step = self._step(np.abs(slope).mean(axis=0), np.abs(found.outputs[0]).mean(axis=0))
                for sign in (1.0, -1.0):
                    moved.append(one)
                    nudges.append(sign * step * slope)
                    steps.append(step)
        runs = self._run(moved, nudges)
        records = [k for k in good for _ in range(2 * len(splines.columns))]
        base = self._read(courses)
        outputs = self._moved_outputs(runs, records, courses, base)
        for number, k in enumerate(records[::2]):
            step = steps[2 * number]
            if step:
                slope = (outputs[2 * number] - outputs[2 * number + 1]) / (2.0 * step)
                slopes[k][:, :, first + number % len(splines.columns)] += slope


def _acting(excitation: Excitation, late: Floats) -> Floats:
    """All times at which commands of a record act, of which `late` are those with delays."""
    return np.concatenate([excitation.switch_times, late[np.isfinite(late)]])


def _or_nan(run: _Courses, values: Floats) -> Floats:
    return values if not run.reason else np.full_like(values, np.nan)


def _names(exprs: Sequence[Expr]) -> set[str]:
    return {variable.name for expr in exprs for variable in variables_of(expr)}
