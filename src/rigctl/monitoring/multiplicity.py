"""What has changed: the series of every quantity tested, with control of the family-wise level.

All quantities are tested together at one level (Holm), each with all possible change points. A quantity that
changes need not be the cause: a leak also moves a fitted friction, and every effect with a similar signature.
`rigctl.monitoring.changed_effect` determines which effect it is.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.decision_levels import SURVEY_ALPHA
from rigctl.monitoring.change_point import FEWEST_BESIDE
from rigctl.monitoring.course import Shape, chi2_about, scatter_between, shape_of, standardised, total_scatter
from rigctl.monitoring.evaluation import Plan, Reading, solved
from rigctl.monitoring.significance import COARSE, FINE, STRONGEST, Scan, best_possible, critical, scan

Floats = NDArray[np.float64]

#: a value at a larger distance from its series than this is an outlier, in standard deviations
APART = 6.0
#: largest number of further steps after the first
_STEPS = 12
#: largest scatter, in standard deviations of an entry, of the neighbours that define the local level
_AROUND = 4


@dataclass(frozen=True)
class Quantity:
    """A parameter or an effect's size, as a quantity of a survey.

    Attributes
    ----------
    name: of the parameter, or of the effect.
    column: its index among the plan's columns; `beside` those of the effect's other parameters.
    offset: added to a step of a held parameter or of an effect, SI.
    kind: ``parameter`` freed in each run, ``held`` or ``effect``.
    unit: in which it is shown; `difference` for a temperature difference.
    """

    name: str
    kind: str
    column: int
    beside: tuple[int, ...]
    offset: float
    unit: str
    meaning: str = ""
    difference: bool = False


@dataclass(frozen=True)
class QuantitySeries:
    """The values of one quantity, by run; NaN if a run does not determine it."""

    quantity: Quantity
    values: Floats = field(repr=False)
    std: Floats = field(repr=False)
    over: Floats = field(repr=False)

    @property
    def known(self) -> NDArray[np.intp]:
        """The indices of the runs that determine it."""
        return np.flatnonzero(np.isfinite(self.values))


@dataclass(frozen=True)
class Tested:
    """A series and the result of its test.

    Attributes
    ----------
    p_value: Holm's, over all quantities; None if it could not be tested.
    between: the scatter from run to run beyond the runs' standard errors, SI; None if there are too few runs.
    apart: indices of runs that are outliers among their neighbours.
    """

    course: QuantitySeries
    found: Scan | None
    p_value: float | None
    between: float | None
    apart: tuple[int, ...] = ()

    @property
    def gain(self) -> float:
        """Increase of χ² over all runs if the quantity were constant: beyond the runs' scatter."""
        known = self.course.known
        values = self.course.values[known]
        if values.size < 2:
            return 0.0
        weights = 1.0 / np.square(total_scatter(values, self.course.std[known]))
        return float(np.sum(weights * np.square(values - np.sum(weights * values) / np.sum(weights))))


@dataclass(frozen=True)
class Change:
    """One detected change.

    Attributes
    ----------
    quantity: the nearest quantity; `alike` the others that these runs do not distinguish from it.
    p_value: Holm's; for an effect named by a diagnosis, that of the most significant change.
    shape: of the change; `steps` the numbers of runs before each step, if there are several.
    levels: of the periods between the steps, SI.
    first_sure: number of runs after which a change of anything was first significant.
    course: the fitted series.
    """

    quantity: Quantity
    alike: tuple[str, ...]
    p_value: float
    shape: Shape
    steps: tuple[int, ...]
    levels: tuple[float, ...]
    first_sure: int
    course: QuantitySeries = field(repr=False)


@dataclass(frozen=True)
class Judged:
    """The findings of a survey.

    Attributes
    ----------
    tested: every quantity, by increasing p-value.
    level: a quantity is called changed if its own p-value, as the most significant one, is below this.
    enough: False if so few runs cannot show a change however clear it is.
    """

    tested: tuple[Tested, ...]
    level: float
    enough: bool

    @property
    def changed(self) -> tuple[Tested, ...]:
        """The quantities that change, those with the largest gain in χ² first."""
        changed = [one for one in self.tested if _or_one(one.p_value) <= SURVEY_ALPHA]
        return tuple(sorted(changed, key=lambda one: -one.gain))

    @property
    def p_value(self) -> float:
        """The p-value of the most significant change, and so of any change at all."""
        return min((_or_one(one.p_value) for one in self.tested), default=1.0)

    @property
    def first_sure(self) -> int:
        """Number of runs after which a change of anything was first significant."""
        return min((sure_from(one, self.level) for one in self.changed), default=0)


def course_of(
    plan: Plan, readings: Sequence[Reading], over: Floats, quantity: Quantity, others: Sequence[Quantity] = ()
) -> QuantitySeries:
    """The series of a quantity over the readings, with `others` freed beside it in each run."""
    # What is freed in every run stays free beside each quantity: otherwise a parameter that has drifted would
    # move every effect that resembles it.
    freed = {*range(len(plan.freed)), quantity.column, *quantity.beside}
    for other in others:
        freed |= {other.column, *other.beside}
    values, std = np.full(len(readings), np.nan), np.full(len(readings), np.nan)
    for k, reading in enumerate(readings):
        if quantity.kind == "parameter":
            fitted = float(reading.values[quantity.column])
            if quantity.name in reading.at_bound and not others:
                values[k] = fitted
                continue
        else:
            fitted = quantity.offset
        step, error = solved(reading, quantity.column, sorted(freed))
        values[k], std[k] = fitted + step, error * max(1.0, reading.chi2_reduced) ** 0.5
    known = std[np.isfinite(std)]
    std = np.where(np.isfinite(std), std, float(np.median(known)) if known.size else 0.0)
    return QuantitySeries(quantity, values, std, over)


def judge(plan: Plan, readings: Sequence[Reading], over: Floats, quantities: Sequence[Quantity]) -> Judged:
    """Test every quantity, and determine what has changed."""
    # 1. A series for each quantity, from the stored normal equations.
    courses = [course_of(plan, readings, over, one) for one in quantities]
    scans = {one.quantity.name: _scanned(one) for one in courses}
    testable = [name for name, one in scans.items() if one is not None]
    # 2. Each tested by its own null distribution, which depends on the number of runs and their correlation;
    #    then one level for all of them.
    adjusted = _holm({name: one.p_value for name, one in scans.items() if one is not None})
    tested = [
        Tested(
            one,
            scans[one.quantity.name],
            adjusted.get(one.quantity.name),
            scatter_between(one.values[one.known], one.std[one.known]),
            _apart(one),
        )
        for one in courses
    ]
    tested.sort(key=lambda one: (_or_one(one.p_value), -(one.found.statistic if one.found else 0.0)))
    level = SURVEY_ALPHA / max(1, len(testable))
    return Judged(tuple(tested), level, best_possible(over) <= level if testable else False)


def change_of(tested: Tested, judged: Judged, alike: tuple[str, ...] = ()) -> Change:
    """A quantity's change, from its series."""
    course = tested.course
    alike_by = _likeness(tested)
    # One change is described: a step or a ramp; or several steps, if these fit better by more than a height
    # and a location for each costs.
    shape, steps = _shape(course, alike_by), _steps(course)
    known = course.known
    values, std = course.values[known], course.std[known]
    edges = [0, *(int(np.searchsorted(known, step)) for step in steps), known.size]
    parts = [(first, last) for first, last in pairwise(edges) if last > first]
    levels = np.concatenate(
        [np.full(last - first, float(np.median(values[first:last]))) for first, last in parts]
    )
    # penalty of each step: its height and its location
    dear = 2.0 * len(steps) * math.log(max(known.size, 2))
    if not steps or chi2_about(levels, values, std) + dear > shape.cost + 2.0 * math.log(max(known.size, 2)):
        steps = ()
    stated_levels = tuple(float(levels[first]) for first, _ in parts) if steps else ()
    if steps:
        one = _shape(course, alike_by, steps=True)
        first = steps[0]
        several = replace(
            one, before=stated_levels[0], after=stated_levels[-1], begins=first, earliest=first, latest=first
        )
        shape = several if len(steps) > 1 else one
    sure, p_value = sure_from(tested, judged.level), _or_one(tested.p_value)
    return Change(course.quantity, alike, p_value, shape, steps, stated_levels, sure, course)


def sure_from(tested: Tested, level: float) -> int:
    """Number of runs after which a quantity's change was first significant."""
    course, scanned = tested.course, tested.found
    known = course.known
    if scanned is None:
        return course.values.size
    count = scanned.first_end(critical(course.over[known], scanned.correlation, level))
    return int(known[(count or known.size) - 1]) + 1


def _scanned(course: QuantitySeries, draws: int = FINE) -> Scan | None:
    known = course.known
    if known.size < 2 * FEWEST_BESIDE or len(set(course.over[known].tolist())) < 2:
        return None
    values = course.values[known]
    if float(np.ptp(values)) == 0.0:
        return None
    return scan(standardised(values, course.std[known]), course.over[known], draws=draws)


def _holm(p_values: dict[str, float]) -> dict[str, float]:
    """Adjusted p-values: each the smallest level at which it would be called a change."""
    adjusted: dict[str, float] = {}
    largest = 0.0
    for rank, (name, p) in enumerate(sorted(p_values.items(), key=lambda item: item[1])):
        largest = max(largest, min(1.0, (len(p_values) - rank) * p))
        adjusted[name] = largest
    return adjusted


def _or_one(p_value: float | None) -> float:
    return 1.0 if p_value is None else p_value


def _likeness(tested: Tested) -> float:
    """The autocorrelation by which the levels' standard deviations are increased."""
    return 0.0 if tested.found is None else min(max(tested.found.correlation, 0.0), STRONGEST)


def _shape(course: QuantitySeries, correlation: float, *, steps: bool = False) -> Shape:
    """The shape, its numbers of runs counted among all runs of the survey."""
    known = course.known
    values, std, over = course.values[known], course.std[known], course.over[known]
    shape = shape_of(values, std, over, correlation, steps=steps)
    at = [int(known[min(k, known.size - 1)]) for k in (shape.begins, shape.earliest, shape.latest)]
    return replace(shape, begins=at[0], earliest=at[1], latest=at[2])


def _steps(course: QuantitySeries) -> tuple[int, ...]:
    """The numbers of runs before each step: the series is split where it changes, and each part again.

    That the series changes is already established: each further step is tested by itself.
    """
    known = course.known
    parts: list[tuple[int, int]] = [(0, known.size)]
    cuts: list[int] = []
    while parts and len(cuts) < _STEPS:
        first, last = parts.pop()
        indices = known[first:last]
        part = QuantitySeries(
            course.quantity, course.values[indices], course.std[indices], course.over[indices]
        )
        scanned = _scanned(part, COARSE)
        if scanned is None or scanned.p_value > SURVEY_ALPHA:
            continue
        cut = shape_of(part.values, part.std, np.arange(indices.size, dtype=float), 0.0, steps=True).begins
        cuts.append(first + cut)
        parts += [(first, first + cut), (first + cut, last)]
    return tuple(int(known[cut]) for cut in sorted(cuts))


def _apart(course: QuantitySeries) -> tuple[int, ...]:
    """The indices of runs far from the median of their neighbours, if these agree with each other."""
    known = course.known
    if known.size < 2 * _AROUND + 1:
        return ()
    values, std = course.values[known], course.std[known]
    total = total_scatter(values, std)
    outliers = []
    for k in range(known.size):
        low = max(0, min(k - _AROUND, known.size - 2 * _AROUND - 1))
        around = np.delete(values[low : low + 2 * _AROUND + 1], k - low)
        if total[k] > 0.0 and abs(values[k] - float(np.median(around))) > APART * total[k]:
            outliers.append(int(known[k]))
    return tuple(outliers)
