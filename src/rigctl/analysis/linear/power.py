"""Power of the data: which effects might be present at their typical size and not be detected."""

from __future__ import annotations

import math

from rigctl.analysis.decision_levels import ALPHA, SEEN_IN_LIBRARY
from rigctl.analysis.linear.nuisance_projection import Projected


def hidden_at_typical_size(projected: Projected) -> tuple[str, ...]:
    """The effects that these data might miss at their typical size: ``‖s̃‖·|φ_typical| < 4.5``.

    At that limit one of K effects is detected with probability ``Φ(4.5 − z)``, z the quantile of
    ``1 − ALPHA/(3·K)``.
    """
    lin = projected.linearisation
    detectable: dict[str, bool] = {}
    for index, candidate in enumerate(lin.candidates):
        for column, name in enumerate(candidate.columns):
            parameter = candidate.parameter(name)
            typical = abs(parameter.start - parameter.at_null)
            statistic = float(projected.lengths[lin.starts[index] + column]) * typical
            detectable[candidate.name] = detectable.get(candidate.name, False) or statistic >= SEEN_IN_LIBRARY
    return tuple(name for name, visible in detectable.items() if not visible)


def significant_size(degrees: float, effects: int, tests: int) -> float:
    """The size in sigmas from which the largest of several effects is significant at `ALPHA`.

    Student's t quantile at ``ALPHA/(2·effects·tests)``: Bonferroni's bound, over the effects, and over the
    tests of which the smallest p-value counts.

    Parameters
    ----------
    degrees: degrees of freedom of the noise; infinite if it is known.
    effects: that these data can test.
    tests: number of tests of a model's adequacy.
    """
    from scipy.special import ndtri, stdtrit

    level = 0.5 * ALPHA / (max(effects, 1) * max(tests, 1))
    return -float(stdtrit(degrees, level) if math.isfinite(degrees) else ndtri(level))
