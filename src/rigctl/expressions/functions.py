"""The functions of the grammar, and arithmetic that never raises: what has no value is NaN."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType


@dataclass(frozen=True, slots=True)
class Function:
    """A function by its name in the grammar; `single` ones take one value, the others two or more."""

    compute: Callable[..., float]
    single: bool = True

    def takes(self, count: int) -> bool:
        """Whether it can be called with so many values."""
        return count == 1 if self.single else count >= 2


def square_root(x: float) -> float:
    """√x; NaN below zero."""
    return math.sqrt(x) if x >= 0.0 else math.nan


def exponential(x: float) -> float:
    """e^x; infinite where it is too large for a float."""
    try:
        return math.exp(x)
    except OverflowError:
        return math.inf


def logarithm(x: float) -> float:
    """Natural logarithm; −∞ at zero, NaN below."""
    if x > 0.0:
        return math.log(x)
    return -math.inf if x == 0.0 else math.nan


def divide(a: float, b: float) -> float:
    """a/b; NaN for a division by zero."""
    return a / b if b != 0.0 else math.nan


def power(a: float, b: float) -> float:
    """a^b; NaN where it is not real or not defined, infinite where it is too large."""
    try:
        return math.pow(a, b)
    except OverflowError:
        return math.inf
    except ValueError:
        return math.nan


def smallest(*values: float) -> float:
    """The smallest value; NaN when one of them is."""
    return math.nan if any(value != value for value in values) else min(values)  # noqa: PLR0124


def largest(*values: float) -> float:
    """The largest value; NaN when one of them is."""
    return math.nan if any(value != value for value in values) else max(values)  # noqa: PLR0124


FUNCTIONS: Mapping[str, Function] = MappingProxyType(
    {
        "abs": Function(math.fabs),
        "min": Function(smallest, single=False),
        "max": Function(largest, single=False),
        "sqrt": Function(square_root),
        "exp": Function(exponential),
        "log": Function(logarithm),
    }
)
