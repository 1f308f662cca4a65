"""Trends over each operating variable, as measured and as modelled, in words.

In: a fit. Out: a `Trend` for each channel and operating variable. Each record counts as one number (a stroke,
or a final level), which is regressed on the variables: the predictions have the record-level unknowns at
their expected values, since fitted ones may have compensated for a wrong model. A trend shows a person what
the tests find without saying it: that the model changes in the wrong direction.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.decision_levels import TOLERANCE, TREND
from rigctl.model.fit.fit import FitResult
from rigctl.model.measured.conditions import commanded_levels, variable_units
from rigctl.notebook import worded
from rigctl.units import parse_unit

Floats = NDArray[np.float64]

#: least change that is displayed as one: a share, or kelvin
LEAST_SHOWN = {"1": 5e-4, "K": 5e-3}
#: least share of a command's variation, and of each variable's, that is not determined by the others
_OWN = 0.3
#: largest z that is stated: beyond it the tail of a distribution is zero in floating point
_LARGEST = 37.0


@dataclass(frozen=True)
class Trend:
    """The change of a quantity over one operating variable, as measured and as modelled.

    Attributes
    ----------
    quantity: what changes, e.g. ``stroke``.
    variable: the operating variable; low, high its ends, SI.
    measured, predicted: change of the quantity from low to high as a share of its mean at low; for a
        temperature in kelvin, because its zero is arbitrary.
    z: the difference of the two in standard errors, as a quantile of the normal distribution; 0 for two
        records, which do not show by how much others would differ.
    shown: the unit in which the variable is shown.
    unit: of the two changes, "1" or "K".
    """

    quantity: str
    variable: str
    low: float
    high: float
    measured: float
    predicted: float
    z: float
    shown: str
    unit: str = "1"

    @property
    def matters(self) -> bool:
        """True if the model is off by more than a third of a per cent; for a temperature, of the change
        itself."""
        scale = 1.0 if self.unit == "1" else max(abs(self.measured), abs(self.predicted))
        return abs(self.measured - self.predicted) > scale / 300

    @property
    def wrong_sign(self) -> bool:
        """True if the measured change is significant, and the model's is opposite and not negligible: large
        enough to be displayed, and a tenth of the measured one."""
        measured = abs(self.z * self.measured) > TREND * abs(self.measured - self.predicted)
        least = max(LEAST_SHOWN[self.unit], TOLERANCE * abs(self.measured))
        return self.measured * self.predicted < 0.0 and measured and abs(self.predicted) >= least

    @property
    def significant(self) -> bool:
        """True if the model is wrong by more than what chance does in one of four trends with probability
        `ALPHA`."""
        return abs(self.z) > TREND

    def document(self) -> dict[str, Any]:
        """Its machine-readable form."""
        return {
            "quantity": self.quantity,
            "variable": self.variable,
            "measured": self.measured,
            "predicted": self.predicted,
            "unit": self.unit,
            "z": self.z,
            "wrong_sign": self.wrong_sign,
            "text": worded(self, "trends.trend_text"),
        }


def trends(fit: FitResult) -> tuple[Trend, ...]:
    """The trends of every quantity over every operating variable, the worst modelled first."""
    measurements, records = fit.problem.measurements, [fit.problem.records[k] for k in fit.fitted]
    units = variable_units(measurements)
    points = {
        name: np.array([record.condition.get(name, math.nan) for record in records])
        for name in measurements.variables
    }
    # A command that is no operating variable, but differs between records, is a column of the plane as well:
    # its influence must not be taken for that of a variable that happens to go with it.
    levels = [commanded_levels(measurements, record) for record in records]
    commands = {
        name: np.array([level.get(name, math.nan) for level in levels])
        for name in measurements.inputs
        if name not in points
    }
    result = []
    for quantity, column, measured, predicted, noise in _quantities(fit):
        kelvin = parse_unit(measurements.units[column]).absolute_temperature
        for variable in points:
            if variable == quantity:
                continue
            # One number for each record, regressed on 1, this variable, the others and the commands: the
            # coefficient of the variable is what it does with the others held.
            plane = _plane(variable, points, commands, np.isfinite(measured))
            if plane is not None:
                trend = _trend(
                    quantity, variable, units[variable], plane, measured, predicted, noise, kelvin=kelvin
                )
                result += [] if trend is None else [trend]
    return tuple(sorted(result, key=lambda trend: -abs(trend.z)))


@dataclass(frozen=True)
class _Level:
    """One number of a record: what it is, as measured and as predicted, SI, and how many standard deviations
    of one reading its noise has."""

    quantity: str
    measured: float
    predicted: float
    noise: float


def _quantities(fit: FitResult) -> list[tuple[str, int, Floats, Floats, float]]:
    """(name, channel, measured, predicted, noise) of one number for each fitted record."""
    quantities = []
    problem = fit.problem
    for column, channel in enumerate(problem.measurements.outputs):
        levels = [_level(fit, k, column) for k in fit.fitted]
        measured = np.array([one.measured for one in levels])
        predicted = np.array([one.predicted for one in levels])
        known = np.isfinite(measured)
        if known.sum() >= 2:
            name = levels[0].quantity if levels else channel
            noise = float(
                np.sqrt(np.mean([one.noise**2 for one, here in zip(levels, known, strict=True) if here]))
            )
            quantities.append((name, column, measured, predicted, noise * float(problem.noise.sigma[column])))
    return quantities


def _level(fit: FitResult, k: int, column: int) -> _Level:
    """One number of a record: the stroke of a position, else the mean over the record's last phase."""
    record, ok = fit.problem.records[k], fit.problem.ok[k][:, column]
    channel = fit.problem.measurements.outputs[column]
    phase = record.phases.index("hold") if "hold" in record.phases and channel == "position" else None
    at_end = record.phase == (len(record.phases) - 1 if phase is None else phase)
    rows = at_end & ok if (at_end & ok).any() else ok
    if not rows.any():
        return _Level(channel, math.nan, math.nan, math.nan)
    before = (record.phase == 0) & ok
    begins = phase is not None and phase > 0 and bool(before.any())

    def of(values: Floats) -> float:
        level = float(values[rows, column].mean())
        return level - float(values[before, column].mean()) if begins else level

    noise = math.sqrt(1.0 / rows.sum() + (1.0 / before.sum() if begins else 0.0))
    name = channel if phase is None else "stroke"
    return _Level(name, of(record.values), of(fit.expected_outputs[k]), noise)


@dataclass(frozen=True)
class _Plane:
    """The plane over the operating variables that is fitted to one number of each record.

    Attributes
    ----------
    rows: (records) True for those that have the variable and the number.
    points: (n) the variable in these, SI.
    matrix: M, n × p, each column scaled to a largest magnitude of 1; the second is the variable.
    inverse: M⁺, p × n.
    """

    rows: NDArray[np.bool_]
    points: Floats
    matrix: Floats
    inverse: Floats

    @property
    def slope(self) -> Floats:
        """(n) weights of the records in the change from the low to the high end of the variable."""
        return np.asarray(self.inverse[1] * np.ptp(self.points) / (np.abs(self.points).max() or 1.0))

    @property
    def degrees(self) -> int:
        """Degrees of freedom that are left: n less the rank of M, which is the trace of ``M M⁺``."""
        return self.points.size - round(float(np.sum(self.matrix.T * self.inverse)))


def _plane(
    variable: str, points: Mapping[str, Floats], commands: Mapping[str, Floats], known: NDArray[np.bool_]
) -> _Plane | None:
    """The plane of a variable, beside the others and the commands; None if the variable does not vary."""
    rows = np.isfinite(points[variable]) & known
    of_variable = points[variable][rows]
    if np.unique(of_variable).size < 2:
        return None
    others = [one for name, one in points.items() if name != variable]
    varying = [one for one in others if np.unique(one[np.isfinite(one)]).size > 1]
    alone = np.column_stack([np.ones(of_variable.size), of_variable])
    matrix = _with_commands(np.column_stack([alone, *(one[rows] for one in varying)]), commands, rows)
    if not np.isfinite(matrix).all() or matrix.shape[0] <= matrix.shape[1]:
        matrix = alone
    matrix = _scaled(matrix)
    return _Plane(rows, of_variable, matrix, np.asarray(np.linalg.pinv(matrix)))


def _scaled(matrix: Floats) -> Floats:
    """Each column divided by its largest magnitude."""
    scale = np.abs(matrix).max(axis=0)
    return np.asarray(matrix / np.where(scale > 0.0, scale, 1.0))


def _with_commands(matrix: Floats, commands: Mapping[str, Floats], rows: NDArray[np.bool_]) -> Floats:
    """The columns of a plane, with the levels of those actuators that are no operating variable.

    Where a temperature is measured, it alone may distinguish the records: what a voltage does to them would
    count as its effect. A command that goes with the variables, which no plane separates, is left out.
    """
    for levels in commands.values():
        wider = np.column_stack([matrix, levels[rows]])
        if wider.shape[0] > wider.shape[1] and np.isfinite(wider).all() and _independent(wider):
            matrix = wider
    return matrix


def _independent(matrix: Floats) -> bool:
    """Whether each column but the first, which is constant, keeps a share of its variation beside the
    others."""
    for index in range(1, matrix.shape[1]):
        column = matrix[:, index] - matrix[:, index].mean()
        rest = _scaled(np.delete(matrix, index, axis=1))
        left = column - rest @ np.linalg.lstsq(rest, column, rcond=None)[0]
        if not np.linalg.norm(left) > _OWN * np.linalg.norm(column):
            return False
    return True


def _trend(
    quantity: str,
    variable: str,
    unit: str,
    plane: _Plane,
    measured: Floats,
    predicted: Floats,
    noise: float,
    *,
    kelvin: bool,
) -> Trend | None:
    measured, predicted = measured[plane.rows], predicted[plane.rows]
    low, high = float(plane.points.min()), float(plane.points.max())
    base = 1.0 if kelvin else abs(float(np.mean(measured[plane.points == low])))
    if base == 0.0 or noise == 0.0:
        return None
    share, predicted_share = (float(plane.slope @ one) / base for one in (measured, predicted))
    z = _standardised(plane, predicted - measured, noise)
    return Trend(quantity, variable, low, high, share, predicted_share, z, unit, "K" if kelvin else "1")


def _standardised(plane: _Plane, difference: Floats, noise: float) -> float:
    """The change of the differences between model and measurement over the variable, in standard errors.

    ``w·d / (s ‖w‖)`` with ``s² = |d − M M⁺d|² / (n − p)``, Student's t with ``n − p`` degrees of freedom, as
    the quantile of the normal distribution with the same tail: what differs from record to record (a supply,
    a room, a gauge) counts as well as the noise of the readings. No larger than with that noise alone; 0 if
    no degree of freedom is left.

    Parameters
    ----------
    difference: d, predicted less measured, n.
    noise: standard deviation of d due to the noise of the readings.
    """
    from scipy.special import ndtri, stdtr

    if plane.degrees < 1:
        return 0.0
    change, norm = float(plane.slope @ difference), float(np.linalg.norm(plane.slope))
    residual = difference - plane.matrix @ (plane.inverse @ difference)
    scatter = float(np.linalg.norm(residual)) / math.sqrt(plane.degrees)
    within_noise = min(abs(change) / (noise * norm), _LARGEST)
    t = abs(change) / (scatter * norm) if scatter > 0.0 else math.inf
    return math.copysign(min(within_noise, -float(ndtri(stdtr(plane.degrees, -t)))), change)
