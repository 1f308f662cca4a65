"""A calibration polynomial from reference values and raw readings, with its uncertainty.

The model ``reference_i = sum_k c_k·x_i^k + e_i`` is fitted by least squares to points whose x is the mean of
repeated raw readings (NIST/SEMATECH e-Handbook of Statistical Methods, 2.3.6; Draper and Smith, Applied
Regression Analysis, 3.1).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import fmean, stdev

import numpy as np
from numpy.typing import NDArray

from rigctl.errors import RigctlError
from rigctl.rig.calibration import monotonic, polynomial
from rigctl.rig.channel import Channel
from rigctl.units import parse_unit

COVERAGE = 0.95
_CURVED = 0.01  # p-value below which a higher degree is suggested
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Point:
    """One reference value in the channel's display unit, and the raw readings that were taken at it."""

    reference: float
    raw: tuple[float, ...]

    @property
    def mean(self) -> float:
        """The mean of the raw readings."""
        return fmean(self.raw)

    @property
    def scatter(self) -> float | None:
        """The sample standard deviation of the raw readings; None for a single one."""
        return stdev(self.raw) if len(self.raw) > 1 else None


@dataclass(frozen=True)
class CalibrationFit:
    """The result of a calibration fit. Values are in the channel's display unit.

    Parameters
    ----------
    points: the points to which the polynomial was fitted.
    coefficients: the coefficients of the polynomial, lowest power first.
    std: their standard deviations; NaN if they cannot be estimated.
    residuals: reference less polynomial, for each point.
    residual_std: standard deviation of the residuals, with ``n - p`` degrees of freedom; None with as many
        points as coefficients.
    uncertainty: 95 % uncertainty of a calibrated value within the range of the points.
    curvature_p_value: p-value of the F test for the next higher power; None if it cannot be tested.
    """

    points: tuple[Point, ...]
    coefficients: tuple[float, ...]
    std: tuple[float, ...]
    residuals: tuple[float, ...]
    residual_std: float | None
    uncertainty: float
    curvature_p_value: float | None

    @property
    def degree(self) -> int:
        """The degree of the polynomial."""
        return len(self.coefficients) - 1

    @property
    def bent(self) -> bool:
        """Whether a polynomial of the next higher degree would fit significantly better."""
        return self.curvature_p_value is not None and self.curvature_p_value < _CURVED

    def largest_change(self, before: Sequence[float]) -> float:
        """Return the largest absolute difference from another polynomial within the range of the points."""
        low, high = min(p.mean for p in self.points), max(p.mean for p in self.points)
        grid = [low + (high - low) * i / 100 for i in range(101)]
        return max(abs(polynomial(self.coefficients, x) - polynomial(before, x)) for x in grid)


def fit_calibration(
    channel: Channel, points: Sequence[Point], degree: int = 1, *, reference_uncertainty: float = 0.0
) -> CalibrationFit:
    """Fit a polynomial to the points, and determine the uncertainty of a calibrated value.

    The uncertainty is the root of the sum of the squares of three contributions: of a new reading on the
    fitted curve, ``t·s·sqrt(1 + h)`` with the largest leverage h within the range of the points; of the
    reference; and of the converter's step, with a uniform distribution.

    Parameters
    ----------
    degree: degree of the polynomial; 1 for a straight line.
    reference_uncertainty: 95 % uncertainty of the reference values, in the display unit.

    Raises
    ------
    RigctlError
        there are too few points with different raw values, or the curve is not monotonic over the converter's
        range.
    """
    count = degree + 1
    x = np.array([point.mean for point in points])
    y = np.array([point.reference for point in points])
    _check(channel, x, degree)
    # Raw values are shifted and scaled to about −1 to 1: powers of counts around 4000 would leave no digits.
    centre, width = float(x.mean()), float(np.ptp(x)) / 2.0
    z = (x - centre) / width
    design = np.vander(z, count, increasing=True)
    solved, *_ = np.linalg.lstsq(design, y, rcond=None)
    residuals = y - design @ solved
    to_raw = _powers(centre, width, count)
    coefficients = _without_rounding(to_raw @ solved, x, y)
    raw = channel.raw
    if raw is not None and not monotonic(coefficients, raw.low, raw.high):
        raise RigctlError(
            "the fitted curve turns back within the converter's range: two raw values would read the same",
            value=f"degree {degree}",
            expected="a lower degree, or points over more of the range",
        )
    s, dof, of_residuals = _spread(points, residuals, coefficients, count)
    inverse = np.linalg.inv(design.T @ design)
    grid = np.vander(np.linspace(z.min(), z.max(), 201), count, increasing=True)
    # The largest within the range of the points: at its ends, as a rule.
    leverage = float(np.einsum("ij,jk,ik->i", grid, inverse, grid).max())
    spread = _t(dof) * s * math.sqrt(1.0 + leverage) if dof else 0.0
    # A uniform distribution has the standard deviation step/√12; twice that for 95 %, as the other
    # contributions.
    step = (raw.step if raw else 0.0) * _steepest(coefficients, x) / math.sqrt(12.0) * 2.0
    covariance = to_raw @ inverse @ to_raw.T * s**2
    return CalibrationFit(
        tuple(points),
        coefficients,
        tuple(float(v) for v in np.sqrt(np.diag(covariance))) if dof else (math.nan,) * count,
        tuple(float(value) for value in residuals),
        s if of_residuals else None,
        math.hypot(spread, reference_uncertainty, step),
        _curvature(z, y, count, float(residuals @ residuals)),
    )


def interval(channel: Channel, value: float) -> float:
    """Convert a difference from the channel's display unit to its `interval_unit`."""
    si = channel.display.to_si(value, difference=True)
    return parse_unit(channel.interval_unit).from_si(si, difference=True)


def _check(channel: Channel, x: Array, degree: int) -> None:
    if channel.raw is None and degree > 1:
        raise RigctlError(
            "a curve needs the range of the channel's converter, over which it must not turn back",
            value=f"degree {degree}",
            expected="degree 1, or 'raw: {bits: 12, low: 0, high: 4095}', say, in the rig file",
        )
    distinct = len(np.unique(np.round(x / channel.raw.step, 2) if channel.raw else x))
    if distinct < degree + 1:
        raise RigctlError(
            "too few points with different raw values",
            value=str(distinct),
            expected=f"at least {degree + 1} for degree {degree}",
        )


def _powers(centre: float, width: float, count: int) -> Array:
    """Return the matrix that converts coefficients of ``((x - centre)/width)^k`` to those of ``x^k``."""
    matrix = np.zeros((count, count))
    power = np.array([1.0])
    for k in range(count):
        matrix[: k + 1, k] = power
        power = np.convolve(power, [-centre / width, 1.0 / width])
    return matrix


def _without_rounding(coefficients: Array, x: Array, y: Array) -> tuple[float, ...]:
    """Return the coefficients, with zero for those that contribute less than the references' rounding."""
    least = 1e-12 * float(np.abs(y).max())
    sizes = np.abs(coefficients) * float(np.abs(x).max()) ** np.arange(len(coefficients))
    return tuple(float(c) if size > least else 0.0 for c, size in zip(coefficients, sizes, strict=True))


def _spread(
    points: Sequence[Point], residuals: Array, coefficients: Sequence[float], count: int
) -> tuple[float, int, bool]:
    """Return the standard deviation of a point, its degrees of freedom, and whether it is from the residuals.

    With as many points as coefficients all residuals are zero; the scatter of repeated readings is used
    instead.
    """
    dof = len(points) - count
    if dof > 0:
        return math.sqrt(float(residuals @ residuals) / dof), dof, True
    repeated = [(point, point.scatter) for point in points if point.scatter is not None]
    dof = sum(len(point.raw) - 1 for point, _ in repeated)
    if not dof:
        return 0.0, 0, False
    steepest = _steepest(coefficients, np.array([point.mean for point in points]))
    total = sum((scatter * steepest) ** 2 * (len(point.raw) - 1) for point, scatter in repeated)
    return math.sqrt(total / dof), dof, False


def _steepest(coefficients: Sequence[float], x: Array) -> float:
    """Return the largest absolute slope within the range of the points, display unit per raw unit."""
    slopes = [k * c for k, c in enumerate(coefficients)][1:]
    return max(abs(polynomial(slopes, float(at))) for at in np.linspace(x.min(), x.max(), 101))


def _t(dof: int) -> float:
    """Return the quantile of Student's t distribution for a two-sided interval of 95 %."""
    from scipy.stats import t

    return float(t.ppf(0.5 + 0.5 * COVERAGE, dof))


def _curvature(z: Array, y: Array, count: int, before: float) -> float | None:
    """Return the p-value of the F test for the next higher power; None with too few points."""
    from scipy.stats import f

    dof = len(z) - count - 1
    if dof < 1 or len(np.unique(z)) < count + 1:
        return None
    design = np.vander(z, count + 1, increasing=True)
    solved, *_ = np.linalg.lstsq(design, y, rcond=None)
    rest = y - design @ solved
    after = float(rest @ rest)
    scale = float(y @ y) or 1.0
    if before <= 1e-24 * scale:  # both polynomials fit exactly
        return 1.0
    if after <= 1e-24 * scale:
        return 0.0
    return float(f.sf((before - after) / (after / dof), 1, dof))
