"""The term as a curve with its band, over the range that the data visit and nowhere else.

    w(x) = Σ_k b_k·B_k(x),   b ~ N(0, τ²·K),   K_ij = exp(−(i − j)²/(2ℓ²))
    r̃ = S̃·b + e,   e ~ N(0, I)

τ and ℓ are what makes the data most probable. Where the fitted unknowns would do the same, or no sample
lies, the band is as wide as the prior: nothing is claimed there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.shape_tolerance import prior_root
from rigctl.discovery.locate import Located
from rigctl.discovery.open_slots import OpenSlots
from rigctl.engine.one_thread import one_thread
from rigctl.engine.splines import SplineArgument
from rigctl.physics.family import Slot

Floats = NDArray[np.float64]

_POINTS = 41
_FUNCTIONS = 20
#: ℓ, in splines
_SMOOTH = (1.5, 3.0, 6.0)
#: τ times the length of the longest column
_SIZES = np.geomspace(1.0, 1e5, 26)
#: a normal distribution's two-sided 95 %
_WIDTH = 1.96


@dataclass(frozen=True)
class Curve:
    """A term over one variable, SI; `low` and `high` are the ends of its 95 % band."""

    slot: Slot
    over: str
    unit: str
    x: Floats = field(repr=False)
    value: Floats = field(repr=False)
    low: Floats = field(repr=False)
    high: Floats = field(repr=False)

    def document(self) -> dict[str, Any]:
        """Its machine-readable form."""
        points = np.column_stack([self.x, self.value, self.low, self.high]).tolist()
        return {
            "slot": self.slot.name,
            "over": self.over,
            "unit": self.slot.unit,
            "over_unit": self.unit,
            "points": [dict(zip(("x", "value", "low", "high"), row, strict=True)) for row in points],
        }


@one_thread()
def curve_of(opened: OpenSlots, located: Located) -> Curve | None:
    """The curve at a slot over the one variable located there; None where it cannot be told."""
    (driver,) = located.over
    knots = opened.knots(driver, _FUNCTIONS)
    if knots is None:
        return None
    projected = opened.columns([(located.slot, SplineArgument(dict(driver.weights), knots))])
    columns, residual = projected.signatures, projected.residual
    longest = float(np.linalg.norm(columns, axis=0).max(initial=0.0))
    if not longest > 0.0:
        return None
    square, along = columns.T @ columns, columns.T @ residual
    roots = [float(size / longest) * prior_root(_FUNCTIONS, smooth) for smooth in _SMOOTH for size in _SIZES]
    root = max(roots, key=lambda one: _evidence(one.T @ square @ one, one.T @ along))
    inverse = np.linalg.inv(root.T @ square @ root + np.eye(_FUNCTIONS))
    mean, covariance = root @ (inverse @ (root.T @ along)), root @ inverse @ root.T
    x, basis = _points(knots)
    value = basis @ mean
    spread = _WIDTH * np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", basis, covariance, basis), 0.0))
    return Curve(located.slot, driver.name, driver.unit, x, value, value - spread, value + spread)


def curves_of(opened: OpenSlots, located: Sequence[Located], most: int) -> tuple[Curve, ...]:
    """The curves of the places that are wanted most, over one variable each."""
    single = [one for one in located if len(one.over) == 1][:most]
    found = [curve_of(opened, one) for one in single]
    return tuple(one for one in found if one is not None)


def _evidence(square: Floats, along: Floats) -> float:
    """Of amplitudes of unit size: twice the logarithm, but for a constant."""
    matrix = np.eye(along.size) + square
    return float(along @ np.linalg.solve(matrix, along) - np.linalg.slogdet(matrix)[1])


def _points(knots: Floats) -> tuple[Floats, Floats]:
    from scipy.interpolate import BSpline

    x = np.linspace(knots[3], knots[-4], _POINTS)
    inside = np.clip(x, knots[3], np.nextafter(knots[-4], knots[3]))
    return x, BSpline.design_matrix(inside, knots, 3).toarray()
