"""The model with a term of unknown size at each slot, and the signature of any spline of any variable
there.

In: a comparison. Out: `OpenSlots`, from which every hypothesis of a search takes its columns: the
derivatives of the readings by a term ``B_k(x)`` at a slot, integrated with the states, at the fit. Nothing
is compiled for a hypothesis, and no reading is differentiated.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.agreement.slot_disturbance import disturbed_system, level, sort_slots, with_system
from rigctl.analysis.agreement.slot_evidence import some_records
from rigctl.analysis.comparison_result import ModelComparison
from rigctl.analysis.linear.linearisation import linearise
from rigctl.analysis.linear.nuisance_projection import Projected, project
from rigctl.analysis.linear.shape_tolerance import courses, knots_of
from rigctl.effects.drivers import Driver, drivers
from rigctl.effects.registry import library
from rigctl.engine.compile import Progress, compile_system
from rigctl.engine.result_cache import switched_off
from rigctl.engine.splines import SplineArgument, SplineColumn, SplineColumns
from rigctl.engine.trajectories import Trajectories
from rigctl.model.fit.fit import FitResult
from rigctl.model.fit.problem import Problem
from rigctl.physics.family import InputVariable, Slot, StateVariable

Floats = NDArray[np.float64]
#: two variables with a larger correlation than this count as one
_LINE = 0.99999


@dataclass(frozen=True)
class OpenSlots:
    """A fitted model whose slots are open for a term.

    Attributes
    ----------
    fit: of the model as given, on the records that are used.
    problem: these records with a constant term of 0 at each slot.
    slots: those on which some reading depends.
    drivers: states, inputs and differences of them that vary in these data.
    trajectories: the simulated records.
    """

    fit: FitResult = field(repr=False)
    problem: Problem = field(repr=False)
    slots: tuple[Slot, ...]
    drivers: tuple[Driver, ...]
    trajectories: Trajectories = field(repr=False)

    def values(self, driver: Driver) -> Floats:
        """(samples of all records) of a variable, SI."""
        return np.concatenate(courses(self.problem, self.trajectories, driver))

    def unit_of(self, driver: Driver) -> str:
        """The unit in which this bench shows a variable."""
        interval = len(driver.weights) > 1
        return self.problem.measurements.unit_for(driver.unit, interval=interval)

    def knots(self, driver: Driver, functions: int) -> Floats | None:
        """Knots of splines over a variable, with equal numbers of samples between them; None if it is
        constant."""
        return knots_of(courses(self.problem, self.trajectories, driver), functions)

    def columns(self, pairs: Sequence[tuple[Slot, SplineArgument]]) -> Projected:
        """The columns of every spline of each argument at its slot, the fitted unknowns projected off.

        Raises
        ------
        RigctlError
            the model cannot be simulated there.
        """
        return self.project(self.readings(splines_at(pairs)))

    def readings(self, splines: SplineColumns) -> list[Floats]:
        """(n, channels, columns) for each record: the derivatives of the readings."""
        problem, local = self.problem, self.fit.local
        columns: list[Floats] = []
        for part in problem.parts(len(splines.columns)):
            some = problem.only(part)
            slopes = some.simulate(np.empty(0), [local[k] for k in part], splines=splines).require()
            columns += [np.take(array, problem.channels, axis=1) for array in slopes.sensitivities]
        return columns

    def project(self, readings: Sequence[Floats]) -> Projected:
        """Columns of readings, for every record, with the fitted unknowns projected off."""
        names = [str(k) for k in range(readings[0].shape[2])]
        with switched_off():  # large, and needed only once
            linearised = linearise(self.fit, self.fit.problem, (), (names, readings))
        return project(linearised.rearranged((), (), shaped=True))

    def chosen(self, samples: int) -> list[NDArray[np.intp]]:
        """About this many samples of each record, enough to compare columns."""
        return [
            np.arange(0, one.times.size, -(-one.times.size // samples), dtype=np.intp)
            for one in self.problem.records
        ]

    def thinned(self, samples: int) -> OpenSlots:
        """These slots at a selection of samples, to project columns of readings computed before."""
        at = self.chosen(samples)
        fit = self.fit
        outputs = tuple(one[rows] for one, rows in zip(fit.outputs, at, strict=True))
        few = replace(fit, problem=fit.problem.at_samples(at), outputs=outputs)
        return replace(self, fit=few, problem=self.problem.at_samples(at))


def splines_at(pairs: Sequence[tuple[Slot, SplineArgument]]) -> SplineColumns:
    """Every spline of each argument as a term at its slot."""
    columns = [
        SplineColumn({level(slot): 1.0}, (index, k))
        for index, (slot, argument) in enumerate(pairs)
        for k in range(argument.knots.size - 4)
    ]
    return SplineColumns(tuple(argument for _, argument in pairs), tuple(columns))


def products_at(slot: Slot, first: SplineArgument, *others: SplineArgument) -> SplineColumns:
    """All products of splines of one argument and of each other as terms at a slot, ordered by the first."""
    count = first.knots.size - 4
    columns = [
        SplineColumn({level(slot): 1.0}, (0, i), (1 + index, j))
        for index in range(len(others))
        for i in range(count)
        for j in range(count)
    ]
    return SplineColumns((first, *others), tuple(columns))


def open_slots(before: ModelComparison, progress: Progress | None = None) -> OpenSlots:
    """The slots of a compared model, opened; of very many fitted records, and of long ones, a subset is used.

    Raises
    ------
    RigctlError
        the model cannot be simulated at its fit.
    """
    fit = some_records(before.fit)
    inner = fit.problem
    # A constant of size 0 at each slot: its derivative, weighted by splines along the trajectory, is the
    # signature of any smooth term there. The equations are compiled once for all of them.
    moving, reading = sort_slots(inner)
    slots = tuple(slot for slot in inner.model.family.slots if slot in (*moving, *reading))
    compiled = compile_system(disturbed_system(inner, (), slots, 0), progress=progress)
    problem = with_system(inner, fit, compiled, 1.0)
    simulated = problem.simulate(np.empty(0), list(fit.local)).require()
    return OpenSlots(fit, problem, slots, tuple(_different(problem, simulated)), simulated)


def _different(problem: Problem, simulated: Trajectories) -> Iterator[Driver]:
    """The variables that vary in these data; of linearly dependent ones only the first."""
    # A variable that is a linear function of another (a command and its actuator) has the same splines: a
    # second test of it would only cost significance.
    known: list[Floats] = []
    for driver in _drivers(problem):
        values = courses(problem, simulated, driver)
        if knots_of(values) is None:
            continue
        course = np.concatenate(values)
        course = (course - course.mean()) / np.linalg.norm(course - course.mean())
        if all(abs(float(course @ other)) < _LINE for other in known):
            known.append(course)
            yield driver


def _drivers(problem: Problem) -> Iterator[Driver]:
    """Every state and input, and the differences on which effects of the library depend, each once."""
    model = problem.model
    yielded: set[tuple[tuple[str, float], ...]] = set()
    named: tuple[StateVariable | InputVariable, ...] = (*model.family.states, *model.family.inputs)
    for item in named:
        one = Driver(((item.name, 1.0),), item.unit)
        yielded.add(one.weights)
        yield one
    for effect in (*library(model.family).values(), *model.own_effects):
        for driver in drivers(effect) if effect.terms else ():
            if driver.weights not in yielded:
                yielded.add(driver.weights)
                yield driver
