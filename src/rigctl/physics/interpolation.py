"""Look-up tables of a family: a smooth curve through given points, in the engine's own operations.

Each interval from x_i to x_(i+1), h_i wide, adds a polynomial of ``s_i = [(x − x_i)₊ − (x − x_(i+1))₊]/h_i``,
which goes from 0 to 1 over it and stays there; (·)₊ is `positive_part`, so that there is no branch:

    y(x) = y_0 + m_0·[x − x_0 − (x − x_0)₊] + Σ_i p_i(s_i) + m_n·(x − x_n)₊

p_i is the monotone cubic with the slopes m_i at the points (F. N. Fritsch, R. E. Carlson, SIAM J. Numer.
Anal. 17 (1980)), or straight, with corners rounded within a fiftieth of the shorter interval beside them.
Outside, the curve is continued as a straight line with the slope at its end or, if `beyond` is ``level``,
levels off: ``m_n·w·tanh((x − x_n)₊/w)`` with w half the interval beside that end. Every s_i is of order 1, so
that no digits are lost if the points are unevenly spaced, as they would be with sums of powers of x.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np

from rigctl.engine.symbols import Scalar, positive_part, tanh
from rigctl.expressions.types import TableType, type_of_unit
from rigctl.physics.si_unit import si_unit

if TYPE_CHECKING:
    from rigctl.physics.scope import Scope

#: rounding of a piecewise linear curve's corner, as a share of the shorter adjacent interval
_ROUNDED = 0.02
#: rounding at a cubic curve's knots: invisible, but enough for a derivative
_TINY = 1e-7
#: share of the interval beside an end over which a curve levels off beyond it
_LEVELS_WITHIN = 0.5


@dataclass(frozen=True)
class Curve:
    """A table of values y over x.

    Attributes
    ----------
    over, unit: the units of x and of y, as written.
    x, y: (points) SI; x increasing.
    kind: interpolation between the points.
    beyond: extrapolation beyond them.
    """

    name: str
    over: str
    unit: str
    x: tuple[float, ...]
    y: tuple[float, ...]
    kind: Literal["cubic", "linear"] = "cubic"
    meaning: str = ""
    beyond: Literal["line", "level"] = "line"

    @property
    def type(self) -> TableType:
        """Its type in expressions."""
        value, over = type_of_unit(self.unit), type_of_unit(self.over)
        return TableType(value.dimension, value.temperature, over=over)

    def __call__(self, m: Scope, x: Scalar) -> Scalar:
        """Its value at x: an expression, or a number if `m` holds numbers."""
        # The curve is computed over t from 0 to 1, without a unit; the units return in the last line.
        length = self.x[-1] - self.x[0]
        t = (x - m.constant(self.x[0], si_unit(self.over))) / m.constant(length, si_unit(self.over))
        knots, widths, polynomials, (first, last) = self._shape
        plus = [positive_part(t - knot, width) for knot, width in zip(knots, widths, strict=True)]
        inner: Scalar = self._beyond(first, t - plus[0], knots[1] - knots[0]) + self._beyond(
            last, plus[-1], knots[-1] - knots[-2]
        )
        for at_start, at_end, step, (one, two, three) in zip(
            plus, plus[1:], np.diff(knots).tolist(), polynomials, strict=False
        ):
            s = (at_start - at_end) / step
            inner = inner + (s * (one + s * (two + s * three)) if two or three else s * one)
        unit = si_unit(self.unit)
        return m.constant(self.y[0], unit) + m.constant(1.0, unit) * inner

    def _beyond(self, slope: float, distance: Scalar, interval: float) -> Scalar:
        """Change of the curve at a distance from its end, negative at the lower end."""
        if self.beyond == "line" or not slope:
            return slope * distance
        width = _LEVELS_WITHIN * interval
        return slope * width * tanh(distance / width)

    @cached_property
    def _shape(
        self,
    ) -> tuple[list[float], list[float], list[tuple[float, float, float]], tuple[float, float]]:
        """Knots from 0 to 1 and their widths; the coefficients of s, s² and s³; the slopes at both ends."""
        knots = (np.array(self.x) - self.x[0]) / (self.x[-1] - self.x[0])
        steps, changes = np.diff(knots), np.diff(np.array(self.y))
        beside = np.minimum(np.append(steps, steps[-1]), np.insert(steps, 0, steps[0]))
        if self.kind == "linear":
            slopes = changes / steps
            straight = [(float(change), 0.0, 0.0) for change in changes]
            return (
                knots.tolist(),
                (_ROUNDED * beside).tolist(),
                straight,
                (float(slopes[0]), float(slopes[-1])),
            )
        from scipy.interpolate import PchipInterpolator

        slopes = PchipInterpolator(knots, np.array(self.y)).derivative()(knots)
        at_start, at_end = slopes[:-1] * steps, slopes[1:] * steps
        cubic = np.column_stack(
            [at_start, 3.0 * changes - 2.0 * at_start - at_end, at_start + at_end - 2.0 * changes]
        )
        terms = [(float(one), float(two), float(three)) for one, two, three in cubic]
        return knots.tolist(), (_TINY * beside).tolist(), terms, (float(slopes[0]), float(slopes[-1]))
