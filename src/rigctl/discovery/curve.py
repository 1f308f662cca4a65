"""The term as a curve with its band, over the range that the data cover and nowhere else.

    w(x) = Σ_k b_k·B_k(x),   b ~ N(0, τ²·K),   K_ij = exp(−(i − j)²/(2ℓ²))
    r̃ = S̃·b + e,   e ~ N(0, I)

τ and ℓ maximise the marginal likelihood. Where the fitted unknowns can do the same, or there is no sample,
the band is as wide as the prior: nothing is claimed there. For a term of two variables it is the curve over
one of them, times the factor of the other in the best formula.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.decision_levels import INTERVAL
from rigctl.analysis.linear.shape_tolerance import prior_root
from rigctl.discovery.effect_file import factor_text
from rigctl.discovery.formulas import FINE_PRODUCT, Factor, Formula, following, points_over
from rigctl.discovery.locate import Located
from rigctl.discovery.open_slots import OpenSlots, products_at, splines_at
from rigctl.effects.drivers import Driver
from rigctl.engine.one_thread import one_thread
from rigctl.engine.splines import SplineArgument
from rigctl.physics.family import Slot

Floats = NDArray[np.float64]

_POINTS = 41
_FUNCTIONS = 20
#: ℓ, in splines
_SMOOTH = (1.5, 3.0, 6.0)
#: grid of τ, times the length of the longest column
_SIZES = np.geomspace(1.0, 1e5, 26)


@dataclass(frozen=True)
class Curve:
    """A term over one variable, SI; `low` and `high` are the ends of its 95 % band.

    `unit` is that of the variable, and `shown` the one that this bench uses for it. `times` is the factor of
    another variable by which it is multiplied, "" if there is none. `free` is the number of directions left
    out, such as a constant, that the fit absorbs: they may have any size.
    """

    slot: Slot
    over: str
    unit: str
    shown: str
    times: str
    free: int
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
            "times": self.times,
            "free": self.free,
            "unit": self.slot.unit,
            "over_unit": self.unit,
            "points": [dict(zip(("x", "value", "low", "high"), row, strict=True)) for row in points],
        }


@one_thread()
def curve_of(opened: OpenSlots, slot: Slot, over: Driver, beside: Factor | None = None) -> Curve | None:
    """The curve at a slot over a variable; None if it cannot be determined.

    Parameters
    ----------
    beside: a factor of another variable that the curve is multiplied by.
    """
    functions = _FUNCTIONS if beside is None else FINE_PRODUCT
    knots = opened.knots(over, functions)
    readings = None if knots is None else _readings(opened, slot, over, knots, beside)
    if knots is None or readings is None:
        return None
    # b | r ~ N(mean, cov) with the prior b = L·a, a ~ N(0, I): cov = L·(LᵀAL + I)⁻¹·Lᵀ, mean = cov·g, with A
    # = S̃ᵀS̃ and g = S̃ᵀr̃. L contains τ and ℓ, which maximise the evidence over a grid.
    projected = opened.project(readings)
    columns, residual = projected.signatures, projected.residual
    longest = float(np.linalg.norm(columns, axis=0).max(initial=0.0))
    if not longest > 0.0:
        return None
    square, along = columns.T @ columns, columns.T @ residual
    roots = [float(size / longest) * prior_root(functions, smooth) for smooth in _SMOOTH for size in _SIZES]
    root = max(roots, key=lambda one: _evidence(one.T @ square @ one, one.T @ along))
    inverse = np.linalg.inv(root.T @ square @ root + np.eye(functions))
    mean, covariance = root @ (inverse @ (root.T @ along)), root @ inverse @ root.T
    x, basis = _points(knots)
    value, spread, free = _known(basis @ mean, basis @ covariance @ basis.T)
    times = "" if beside is None else factor_text(beside)
    shown = opened.unit_of(over)
    return Curve(slot, over.name, over.unit, shown, times, free, x, value, value - spread, value + spread)


def _readings(
    opened: OpenSlots, slot: Slot, over: Driver, knots: Floats, beside: Factor | None
) -> list[Floats] | None:
    """(n, channels, functions) for each record: the signatures of the splines over a variable, times a
    factor."""
    argument = SplineArgument(dict(over.weights), knots)
    if beside is None:
        return opened.readings(splines_at([(slot, argument)]))
    driver = beside.argument.driver
    others = opened.knots(driver, FINE_PRODUCT)
    if others is None:
        return None
    grid = points_over(others)
    weights = following(grid, others) @ beside.of(grid)
    every = opened.readings(products_at(slot, argument, SplineArgument(dict(driver.weights), others)))
    return [one.reshape(*one.shape[:2], FINE_PRODUCT, FINE_PRODUCT) @ weights for one in every]


def curves_of(
    opened: OpenSlots, formulas: Sequence[Formula], located: Sequence[Located], most: int
) -> tuple[Curve, ...]:
    """The curves of the set of formulas, then of the most probable locations, over one variable each."""
    requests: list[tuple[Slot, Driver, Factor | None]] = []
    for one in formulas:
        first, *others = one.factors
        requests.append((one.slot, first.argument.driver, others[0] if others else None))
    requests += [(one.slot, one.over[0], None) for one in located if len(one.over) == 1]
    curves: dict[tuple[str, str, str], Curve] = {}
    for slot, over, beside in requests:
        key = (slot.name, over.name, "" if beside is None else beside.argument.driver.name)
        if key not in curves and len(curves) < most:
            curve = curve_of(opened, slot, over, beside)
            if curve is not None:
                curves[key] = curve
    return tuple(curves.values())


def _known(mean: Floats, covariance: Floats) -> tuple[Floats, Floats, int]:
    """The curve and its half band without undetermined directions, and the number of these.

    They are eigenvectors of the covariance along which the curve does not differ significantly from 0, and
    which are wider than everything that is determined.
    """
    # Some directions of the curve the fit absorbs whatever their size (a straight line over speed is viscous
    # damping): there the band is as wide as the prior, and would hide what is known of the rest.
    variances, directions = np.linalg.eigh(covariance)
    spreads = np.sqrt(np.maximum(variances, 0.0))
    amplitudes = directions.T @ mean
    determined = np.abs(amplitudes) > INTERVAL * spreads
    known = float(np.linalg.norm(amplitudes[determined]))
    free = ~determined & (spreads > known) if determined.any() else np.zeros(determined.size, dtype=bool)
    basis = directions[:, ~free]
    spread = INTERVAL * np.sqrt(np.maximum(np.square(basis) @ variances[~free], 0.0))
    return basis @ amplitudes[~free], spread, int(free.sum())


def _evidence(square: Floats, along: Floats) -> float:
    """Twice the log evidence for amplitudes of unit size, up to a constant."""
    matrix = np.eye(along.size) + square
    return float(along @ np.linalg.solve(matrix, along) - np.linalg.slogdet(matrix)[1])


def _points(knots: Floats) -> tuple[Floats, Floats]:
    from scipy.interpolate import BSpline

    x = np.linspace(knots[3], knots[-4], _POINTS)
    inside = np.clip(x, knots[3], np.nextafter(knots[-4], knots[3]))
    return x, BSpline.design_matrix(inside, knots, 3).toarray()
