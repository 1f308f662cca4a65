"""What may be said where only the white floor of the noise is known: evidence that needs no noise level.

An effect proves itself if the misfit collapses with it. The test is self-normalised: the gain over what is
left, with as many independent readings as that has correlation times. Nothing else names an effect there; an
error that follows past inputs shows that something is missing, and not what.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from rigctl.analysis.decision_levels import (
    ALPHA,
    COLLAPSE,
    MANY_FLOORS,
    MOSTLY,
    REFUTED,
    SENSOR_SIZE,
)
from rigctl.analysis.search.refit import RefittedSet
from rigctl.analysis.search.search import Search
from rigctl.model.fit.fit import FitResult


def proven_by_collapse(search: Search, best: RefittedSet) -> bool:
    """Whether a set of effects removes so much of the misfit that it needs no noise level.

    It must remove at least the share `COLLAPSE` of the squared error of the channels of which only the floor
    is known, and F = (gain/parameters)/(what is left/independent readings) must be significant at `ALPHA`,
    counting all the sets of as many effects that the library offers.
    """
    from scipy.special import fdtrc

    if not best.candidates:
        return False
    before, after = squares(search.before.fit), squares(best.fit)
    if not before > 0.0 or after > (1.0 - COLLAPSE) * before or not _refutes_statement(search, best):
        return False
    # F = (Δχ²/p)/(χ²/ν) with χ²/ν = 1: χ² is already in the scale of what the set leaves. Bonferroni's factor
    # is the number of sets of this size that the library offers.
    freedom = max(search.samples - len(best.fit.problem.shared), 1.0)
    parameters = max(best.parameters, 1)
    gain = max(search.null.chi2 - best.chi2, 0.0)
    tried = math.comb(max(search.library, 2), len(best.candidates))
    chance = float(fdtrc(parameters, freedom, gain / parameters))
    return tried * chance < ALPHA


def _refutes_statement(search: Search, best: RefittedSet) -> bool:
    """Whether a stated noise that covers what the model leaves is refuted by how little a set leaves."""
    stated = set(search.before.adequacy.stated)
    covered = [one for one in best.fit.problem.noise.channels if one.name in stated]
    return not covered or any(best.fit.errors[one.name].rmse < REFUTED * one.allowed for one in covered)


def squares(fit: FitResult) -> float:
    """Sum over the channels of which only the floor is known: mean squared error in units of the floor."""
    floors = [one for one in fit.problem.noise.channels if one.own_scale and one.floor]
    return sum((fit.errors[one.name].rmse / one.floor) ** 2 for one in floors if one.name in fit.errors)


def times_the_floor(fit: FitResult) -> float:
    """The error of the worst channel of which only the floor is known, in units of that; 0 without one."""
    floors = [one for one in fit.problem.noise.channels if one.own_scale and one.floor]
    return max(
        (fit.errors[one.name].rmse / one.floor for one in floors if one.name in fit.errors), default=0.0
    )


@dataclass(frozen=True)
class ErrorLeft:
    """A set leaves this share of the error, in the worst channel so many `times` the white noise."""

    share: float
    times: float


@dataclass(frozen=True)
class TooLargeForSensor:
    """A sensor effect of so many `times` the noise of a reading, as no sensor's error is.

    A sensor whose readings scatter by a thousandth of such an error was read without it before: what has this
    memory, or depends on this reading, is somewhere else in the bench.
    """

    effect: str
    times: float


def doubts(search: Search, best: RefittedSet) -> list[ErrorLeft]:
    """Why a set that proves itself may still be only the nearest; empty if nothing speaks for that."""
    before, after = squares(search.before.fit), squares(best.fit)
    times = times_the_floor(best.fit)
    if times > MANY_FLOORS and after > MOSTLY * before:
        return [ErrorLeft(math.sqrt(after / before), times)]
    return []


def not_a_sensor(best: RefittedSet) -> list[TooLargeForSensor]:
    """The sensor effects of a set that are too large to be a sensor's."""
    problem = best.fit.problem
    floors = {one.name: one.floor for one in problem.noise.channels}
    found = []
    for candidate in best.candidates:
        channel = next((name for name in floors if candidate.name.endswith(f"_of_{name}")), None)
        floor = 0.0 if channel is None else floors[channel]
        size = f"{candidate.name}.size"
        if not floor or size not in candidate.columns:
            continue
        value = abs(best.value(size)[0] - candidate.parameter(size).at_null)
        if value > SENSOR_SIZE * floor:
            found.append(TooLargeForSensor(candidate.name, value / floor))
    return found
