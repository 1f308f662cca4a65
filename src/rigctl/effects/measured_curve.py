"""A measured curve as the term of an effect: y(x) at a slot, times a fitted factor.

    term = factor·(y(x) + shift·h(x))          where terms are added
    term = 1 + factor·(y(x) + shift·h(x) − 1)  where the slot multiplies

y is the monotone cubic through the points, h that through the half-widths of their band. ``factor`` 0
switches the effect off, 1 is the curve as measured; ``shift`` 1 and −1 are the edges of the band, to which
the curve is shifted as a whole.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from rigctl.effects.declaration import EffectParameter, Own
from rigctl.engine.symbols import Scalar
from rigctl.physics.family import Formula
from rigctl.physics.interpolation import Curve
from rigctl.physics.scope import Scope
from rigctl.units import parse_unit

FACTOR = EffectParameter(
    "factor", "1", 0.0, 1.0, 0.0, 3.0, "share of the measured curve; 1 is the curve itself"
)
#: largest shift of the whole curve in a fit, in half-widths of its band
_WIDEST = 2.0
SHIFT = EffectParameter(
    "shift", "1", None, 0.0, -_WIDEST, _WIDEST, "place in the curve's band: -1 and 1 are its edges"
)


@dataclass(frozen=True)
class MeasuredCurve:
    """The curve of one slot.

    Attributes
    ----------
    of: the curve's argument, as written; `formula` the same in terms of the model's variables.
    curve: through the points.
    low, high: (points) its band, SI; empty if unknown.
    half: the curve through the band's half-widths; None without a band.
    factor: whether the slot multiplies.
    difference: whether the argument is a temperature difference.
    """

    of: str
    formula: Formula
    curve: Curve
    low: tuple[float, ...] = ()
    high: tuple[float, ...] = ()
    half: Curve | None = None
    factor: bool = False
    difference: bool = False

    def __call__(self, m: Scope, p: Own) -> Scalar:
        """The term."""
        x = self.formula(m)
        value = self.curve(m, x)
        if self.half is not None:
            value = value + p.shift * self.half(m, x)
        return 1.0 + p.factor * (value - 1.0) if self.factor else p.factor * value

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        """Parameters of an effect whose law is this curve."""
        return (FACTOR,) if self.half is None else (FACTOR, SHIFT)

    @property
    def equation(self) -> str:
        """In readable form."""
        return f"1 + factor*(curve({self.of}) - 1)" if self.factor else f"factor*curve({self.of})"

    def document(self) -> dict[str, Any]:
        """Its machine-readable form, in the units beside it."""
        over, unit = parse_unit(self.curve.over), parse_unit(self.curve.unit)

        def shown(values: tuple[float, ...]) -> list[float]:
            return [float(f"{value / unit.factor:.12g}") for value in values]

        return {
            "of": self.of,
            "over": self.curve.over,
            "unit": self.curve.unit,
            "x": [float(f"{over.from_si(x, difference=self.difference):.12g}") for x in self.curve.x],
            "y": shown(self.curve.y),
            "low": shown(self.low),
            "high": shown(self.high),
            "beyond": self.curve.beyond,
        }
