"""The minimum of a function of one variable on an interval."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

#: relative accuracy of the location of a minimum: the square root of the rounding error
_ROOT = math.sqrt(2.2e-16)
_GOLDEN = 0.5 * (3.0 - math.sqrt(5.0))
_MOST = 500


class Minimum(NamedTuple):
    """The location of a minimum, and the function's value there."""

    at: float
    value: float


def least_between(function: Callable[[float], float], low: float, high: float, within: float) -> Minimum:
    """The least value found by golden sections and parabolas between `low` and `high`.

    The vertex of the parabola through the three best points is tried next, unless it lies outside the
    interval or converges no faster than the step before the last; then the larger part is divided by the
    golden section. The steps are those of ``scipy.optimize.minimize_scalar(method="bounded")``, whose package
    takes longer to import than most of the searches here take.

    Parameters
    ----------
    within: tolerance of the location.

    Source: R. P. Brent, Algorithms for Minimization without Derivatives (1973), chapter 5.
    """
    best = second = third = low + _GOLDEN * (high - low)
    lowest = function(best)
    next_lowest = third_lowest = lowest
    moved = before = 0.0
    for _ in range(_MOST - 1):
        middle = 0.5 * (low + high)
        near = _ROOT * abs(best) + within / 3.0
        if not abs(best - middle) > 2.0 * near - 0.5 * (high - low):
            break
        step = None
        if abs(before) > near:
            r = (best - second) * (lowest - third_lowest)
            q = (best - third) * (lowest - next_lowest)
            p = (best - third) * q - (best - second) * r
            q = 2.0 * (q - r)
            if q > 0.0:
                p = -p
            q = abs(q)
            r, before = before, moved
            if abs(p) < abs(0.5 * q * r) and p > q * (low - best) and p < q * (high - best):
                step = p / q
                x = best + step
                if x - low < 2.0 * near or high - x < 2.0 * near:
                    step = near * _sign(middle - best)
        if step is None:
            before = low - best if best >= middle else high - best
            step = _GOLDEN * before
        moved = step
        x = best + _sign(step) * max(abs(step), near)
        value = function(x)
        if value <= lowest:
            low, high = (best, high) if x >= best else (low, best)
            third, third_lowest = second, next_lowest
            second, next_lowest = best, lowest
            best, lowest = x, value
            continue
        low, high = (x, high) if x < best else (low, x)
        if value <= next_lowest or second == best:
            third, third_lowest = second, next_lowest
            second, next_lowest = x, value
        elif value <= third_lowest or third in (best, second):
            third, third_lowest = x, value
    return Minimum(best, lowest)


def _sign(value: float) -> float:
    """1 if not negative, else −1."""
    return -1.0 if value < 0.0 else 1.0
