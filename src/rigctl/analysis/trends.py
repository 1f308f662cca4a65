"""Trends over each operating variable, as measured and as modelled, in words."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.localisation import variable_units
from rigctl.model.fit.fit import FitResult
from rigctl.units import parse_unit, show, significant

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Trend:
    """The change of a quantity over one operating variable, as measured and as modelled.

    Attributes
    ----------
    quantity: what changes, e.g. ``stroke``.
    variable: the operating variable; low, high its ends, SI.
    measured, predicted: change of the quantity from low to high as a share of its mean at low; for a
        temperature in kelvin, because its zero is arbitrary.
    unit: of the two, "1" or "K".
    z: the difference of the two in standard deviations.
    wrong_sign: the modelled trend has the wrong sign, significantly.
    """

    quantity: str
    variable: str
    low: float
    high: float
    measured: float
    predicted: float
    z: float
    text: str
    unit: str = "1"

    @property
    def matters(self) -> bool:
        """True if the model is off by more than a third of a per cent; for a temperature, of the change
        itself."""
        scale = 1.0 if self.unit == "1" else max(abs(self.measured), abs(self.predicted))
        return abs(self.measured - self.predicted) > scale / 300

    @property
    def wrong_sign(self) -> bool:
        """True if both changes are significant and have opposite signs."""
        return self.measured * self.predicted < 0.0 and abs(self.z) > 3.0

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
            "text": self.text,
        }


def trends(fit: FitResult) -> tuple[Trend, ...]:
    """The trends of every quantity over every operating variable, the worst modelled first."""
    measurements = fit.problem.measurements
    units = variable_units(measurements)
    result = []
    for quantity, column, measured, predicted, noise in _quantities(fit):
        kelvin = parse_unit(measurements.units[column]).absolute_temperature
        for variable in measurements.variables:
            points = np.array([fit.problem.records[k].condition.get(variable, math.nan) for k in fit.fitted])
            trend = _trend(fit, quantity, variable, points, measured, predicted, noise, units, kelvin=kelvin)
            if trend is not None:
                result.append(trend)
    return tuple(sorted(result, key=lambda trend: -abs(trend.z)))


def _quantities(fit: FitResult) -> list[tuple[str, int, Floats, Floats, float]]:
    """(name, channel, measured, predicted, standard error) of one number for each fitted record."""
    quantities = []
    problem = fit.problem
    for column, channel in enumerate(problem.measurements.outputs):
        pairs = [_level(fit, k, column) for k in fit.fitted]
        measured, predicted = np.array([p[0] for p in pairs]), np.array([p[1] for p in pairs])
        name = pairs[0][2] if pairs else channel
        if np.isfinite(measured).sum() >= 2:
            error = float(problem.noise.sigma[column]) / math.sqrt(max(1.0, pairs[0][3]))
            quantities.append((name, column, measured, predicted, error))
    return quantities


def _level(fit: FitResult, k: int, column: int) -> tuple[float, float, str, float]:
    """One number of a record: the stroke of a position, else the mean over the record's last phase."""
    record, ok = fit.problem.records[k], fit.problem.ok[k][:, column]
    channel = fit.problem.measurements.outputs[column]
    phase = record.phases.index("hold") if "hold" in record.phases and channel == "position" else None
    at_end = record.phase == (len(record.phases) - 1 if phase is None else phase)
    rows = at_end & ok if (at_end & ok).any() else ok
    if not rows.any():
        return math.nan, math.nan, channel, 1.0
    measured, predicted = (
        float(record.values[rows, column].mean()),
        float(fit.expected_outputs[k][rows, column].mean()),
    )
    name = channel
    if phase is not None:
        name = "stroke"
        before = (record.phase == 0) & ok
        if phase > 0 and before.any():
            measured -= float(record.values[before, column].mean())
            predicted -= float(fit.expected_outputs[k][before, column].mean())
    return measured, predicted, name, float(rows.sum())


def _trend(
    fit: FitResult,
    quantity: str,
    variable: str,
    points: Floats,
    measured: Floats,
    predicted: Floats,
    noise: float,
    units: dict[str, str],
    *,
    kelvin: bool,
) -> Trend | None:
    good = np.isfinite(points) & np.isfinite(measured)
    if np.unique(points[good]).size < 2 or variable == quantity:
        return None
    others = [
        np.array([fit.problem.records[k].condition.get(name, math.nan) for k in fit.fitted])
        for name in fit.problem.measurements.variables
        if name != variable
    ]
    columns = [np.ones(points.size), points, *(o for o in others if np.unique(o[np.isfinite(o)]).size > 1)]
    matrix = np.column_stack(columns)[good]
    if not np.isfinite(matrix).all() or matrix.shape[0] <= matrix.shape[1]:
        matrix = np.column_stack([np.ones(points.size), points])[good]
    scale = np.abs(matrix).max(axis=0)
    inverse = np.linalg.pinv(matrix / np.where(scale > 0, scale, 1.0))[1] / (scale[1] or 1.0)
    low, high = float(points[good].min()), float(points[good].max())
    span = high - low
    change, predicted_change = float(inverse @ measured[good]) * span, float(inverse @ predicted[good]) * span
    error = noise * float(np.linalg.norm(inverse)) * span
    base = 1.0 if kelvin else float(np.mean(measured[good][points[good] == low]))
    if base == 0.0 or error == 0.0:
        return None
    share, predicted_share = change / abs(base), predicted_change / abs(base)
    ends = f"from {show(low, units[variable], digits=3)} to {show(high, units[variable], digits=3)}"
    for digits in (2, 3, 4, 2):  # as many as show the difference, unless none do
        moves, predicted_moves = (_moves(one, digits, kelvin=kelvin) for one in (share, predicted_share))
        if moves != predicted_moves:
            break
    text = f"measured {quantity} {moves} {ends}, the model says it {predicted_moves}"
    unit = "K" if kelvin else "1"
    return Trend(
        quantity, variable, low, high, share, predicted_share, (predicted_change - change) / error, text, unit
    )


def _moves(change: float, digits: int, *, kelvin: bool = False) -> str:
    """``rises 4.8 %``, or ``rises 3.2 K``: percentages of an absolute temperature have no meaning."""
    least, size, unit = (5e-3, abs(change), "K") if kelvin else (5e-4, abs(change) * 100, "%")
    moves = "rises" if change > 0.0 else "falls"
    return "stays the same" if abs(change) < least else f"{moves} {significant(size, digits)} {unit}"


def sentence(candidates: Sequence[Trend], notable: float = 5.0) -> str:
    """The worst modelled trend in one sentence; empty if none is wrong."""
    wrong = [trend for trend in candidates if trend.wrong_sign and abs(trend.z) > notable and trend.matters]
    worst = wrong or [trend for trend in candidates if abs(trend.z) > notable and trend.matters]
    if not worst:
        return ""
    text = worst[0].text
    capitalised = text[0].upper() + text[1:]
    return f"{capitalised}: the wrong direction" if worst[0].wrong_sign else capitalised
