"""The functions of the grammar, and arithmetic that never raises: undefined values are NaN.

A condition is evaluated while a bench moves, on whatever the sensors report: an exception there would end
the run. NaN passes through all arithmetic, and every comparison with it is false. The same smooth functions
exist in `rigctl.engine.symbols`, where models are compiled; here they are for single numbers.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType


@dataclass(frozen=True, slots=True)
class Function:
    """A function of the grammar with `count` arguments; None: two or more."""

    compute: Callable[..., float]
    count: int | None = 1
    words: str = ""  # description of its arguments, if they are other than values and a width

    def takes(self, count: int) -> bool:
        """Return whether it can be called with `count` arguments."""
        return count >= 2 if self.count is None else count == self.count

    @property
    def wants(self) -> str:
        """The expected arguments in words, for messages."""
        if self.words:
            return self.words
        return {None: "two values or more", 1: "one value", 2: "a value and a width"}.get(
            self.count, "two values and a width"
        )


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


def sine(x: float) -> float:
    """sin x of an angle in radians; NaN where it is not finite."""
    return math.sin(x) if math.isfinite(x) else math.nan


def cosine(x: float) -> float:
    """cos x of an angle in radians; NaN where it is not finite."""
    return math.cos(x) if math.isfinite(x) else math.nan


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
    """The smallest value; NaN if one of them is NaN."""
    return math.nan if any(value != value for value in values) else min(values)  # noqa: PLR0124


def largest(*values: float) -> float:
    """The largest value; NaN if one of them is NaN."""
    return math.nan if any(value != value for value in values) else max(values)  # noqa: PLR0124


def absolute(x: float, width: float) -> float:
    """√(x² + width²): the smooth magnitude of x."""
    return math.hypot(x, width)


def positive_part(x: float, width: float) -> float:
    """(x + √(x² + width²))/2: smooth max(x, 0)."""
    return 0.5 * (x + math.hypot(x, width))


def minimum(a: float, b: float, width: float) -> float:
    """Smooth minimum of two values."""
    return 0.5 * (a + b - math.hypot(a - b, width))


def maximum(a: float, b: float, width: float) -> float:
    """Smooth maximum of two values."""
    return 0.5 * (a + b + math.hypot(a - b, width))


def smooth_sign(x: float, width: float) -> float:
    """tanh(x/width): −1 below, 1 above."""
    return math.tanh(divide(x, width))


def signed_power(x: float, exponent: float, width: float) -> float:
    """x·(x² + width²)^((exponent − 1)/2): smooth sign(x)·|x|^exponent."""
    return x * power(x * x + width * width, 0.5 * (exponent - 1.0))


def looked_up(_x: float, _table: float) -> float:
    """NaN, since a table has values only in a family of models."""
    return math.nan


def smooth_step(x: float, width: float) -> float:
    """(1 + tanh(x/width))/2: 0 below, 1 above."""
    return 0.5 * (1.0 + smooth_sign(x, width))


FUNCTIONS: Mapping[str, Function] = MappingProxyType(
    {
        "abs": Function(math.fabs),
        "min": Function(smallest, count=None),
        "max": Function(largest, count=None),
        "sqrt": Function(square_root),
        "exp": Function(exponential),
        "log": Function(logarithm),
    }
)

#: further functions for the formulas of models: most are smooth versions of discontinuous or kinked
#: functions, with a width as the last argument
SMOOTH_FUNCTIONS: Mapping[str, Function] = MappingProxyType(
    {
        "tanh": Function(math.tanh),
        "sin": Function(sine),
        "cos": Function(cosine),
        "absolute": Function(absolute, count=2),
        "positive_part": Function(positive_part, count=2),
        "minimum": Function(minimum, count=3),
        "maximum": Function(maximum, count=3),
        "smooth_sign": Function(smooth_sign, count=2),
        "smooth_step": Function(smooth_step, count=2),
        "spow": Function(signed_power, count=3, words="a value, an exponent and a width"),
        "table": Function(looked_up, count=2, words="a value and the name of a table"),
    }
)

#: the functions whose last argument is a width
WITH_WIDTH = frozenset(SMOOTH_FUNCTIONS) - {"tanh", "sin", "cos", "table"}

ALL_FUNCTIONS: Mapping[str, Function] = MappingProxyType({**FUNCTIONS, **SMOOTH_FUNCTIONS})
