"""What may be said where only the white floor of the noise is known: evidence that needs no noise level.

An effect proves itself if the misfit collapses with it. The test is self-normalised: the gain over what is
left, with as many independent readings as that has correlation times. Nothing else names an effect there; an
error that follows past inputs shows that something is missing, and not what.
"""

from __future__ import annotations

import math

from rigctl.analysis.comparison_result import ModelComparison
from rigctl.analysis.decision_levels import ALPHA, COLLAPSE
from rigctl.analysis.refit import RefittedSet
from rigctl.analysis.search import Search
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
    if not before > 0.0 or after > (1.0 - COLLAPSE) * before:
        return False
    freedom = max(search.samples - len(best.fit.problem.shared), 1.0)
    parameters = max(best.parameters, 1)
    gain = max(search.none.chi2 - best.chi2, 0.0)
    tried = math.comb(max(search.library, 2), len(best.candidates))
    chance = float(fdtrc(parameters, freedom, gain / parameters))
    return tried * chance < ALPHA


def squares(fit: FitResult) -> float:
    """Sum over the channels of which only the floor is known: mean squared error in units of the floor."""
    floors = [one for one in fit.problem.noise.channels if one.standing == "floor" and one.floor]
    return sum((fit.errors[one.name].rmse / one.floor) ** 2 for one in floors if one.name in fit.errors)


def times_the_floor(fit: FitResult) -> float:
    """The error of the worst channel of which only the floor is known, in units of that; 0 without one."""
    floors = [one for one in fit.problem.noise.channels if one.standing == "floor" and one.floor]
    return max(
        (fit.errors[one.name].rmse / one.floor for one in floors if one.name in fit.errors), default=0.0
    )


def follows_inputs(before: ModelComparison) -> bool:
    """Whether the errors of a model are correlated with the past of an input."""
    test = before.adequacy.tests.get("inputs")
    return test is not None and test.p_value < ALPHA
