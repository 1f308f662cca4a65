"""Look-up tables of a family: a smooth curve through given points, in the engine's own operations.

``y(x) = y_0 + m_0·(x − x_0) + Σ_i [a_i·(x − x_i)₊² + b_i·(x − x_i)₊³]`` is the monotone piecewise cubic
through the points (F. N. Fritsch, R. E. Carlson, SIAM J. Numer. Anal. 17 (1980)), with a continuous slope and
without a branch: (·)₊ is `positive_part`. ``y_0 + Σ_i s_i·(x − x_i)₊`` is the straight line from point to
point, its corners rounded within a fiftieth of the shorter neighbouring interval. Outside, the curve goes on
as a straight line with the slope at its end.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np

from rigctl.engine.symbols import Scalar, positive_part
from rigctl.expressions.types import TableType, type_of_unit
from rigctl.physics.units import si_unit

if TYPE_CHECKING:
    from rigctl.physics.scope import Scope

#: of a straight curve's corner, as a share of the shorter interval beside it
_ROUNDED = 0.02
#: of a cubic curve's knots: too little to be seen, enough for a derivative
_TINY = 1e-7


@dataclass(frozen=True)
class Curve:
    """A table of values y over x.

    Attributes
    ----------
    over, unit: of x and of y, as they are written.
    x, y: (points) SI; x rises.
    kind: how it goes between the points.
    """

    name: str
    over: str
    unit: str
    x: tuple[float, ...]
    y: tuple[float, ...]
    kind: Literal["cubic", "linear"] = "cubic"
    meaning: str = ""

    @property
    def type(self) -> TableType:
        """What a formula may do with it."""
        value, over = type_of_unit(self.unit), type_of_unit(self.over)
        return TableType(value.dimension, value.temperature, over=over)

    def __call__(self, m: Scope, x: Scalar) -> Scalar:
        """Its value at x, in the quantities of `m`."""
        length = self.x[-1] - self.x[0]
        t = (x - m.constant(self.x[0], si_unit(self.over))) / m.constant(length, si_unit(self.over))
        first, terms = self._terms
        inner: Scalar = first * t
        for knot, width, powers in terms:
            plus = positive_part(t - knot, width)
            for exponent, coefficient in powers:
                inner = inner + coefficient * plus**exponent
        unit = si_unit(self.unit)
        return m.constant(self.y[0], unit) + m.constant(1.0, unit) * inner

    @cached_property
    def _terms(self) -> tuple[float, list[tuple[float, float, list[tuple[int, float]]]]]:
        """The first slope; then each knot, its width, and (exponent, coefficient) of what begins there."""
        knots = (np.array(self.x) - self.x[0]) / (self.x[-1] - self.x[0])
        values = np.array(self.y) - self.y[0]
        steps = np.diff(knots)
        beside = np.minimum(np.append(steps, steps[-1]), np.insert(steps, 0, steps[0]))
        if self.kind == "linear":
            slopes = np.diff(values) / steps
            jumps = np.append(np.diff(slopes), 0.0)
            terms = [
                (float(knot), float(_ROUNDED * width), [(1, float(jump))])
                for knot, width, jump in zip(knots[1:], beside[1:], jumps, strict=True)
                if jump != 0.0
            ]
            return float(slopes[0]), terms
        from scipy.interpolate import PchipInterpolator

        cubic, square, slopes, _ = PchipInterpolator(knots, values).c
        ended = np.append(square, 0.0) - np.insert(square + 3.0 * cubic * steps, 0, 0.0)
        jumps = np.diff(cubic, prepend=0.0, append=0.0)
        terms = [
            (float(knot), float(_TINY * width), [(2, float(a)), (3, float(b))])
            for knot, width, a, b in zip(knots, beside, ended, jumps, strict=True)
        ]
        return float(slopes[0]), terms
