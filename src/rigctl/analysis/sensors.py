"""Is it the sensor or the model? What the errors of calibrations explain, and which of them are too large.

The fit has the errors c of the calibrations among its unknowns, with priors N(0, P) that the rig file states
(`rigctl.model.reading_errors`). With ĉ their estimates and C their covariance, everything else being free,
and as far as the problem is linear,

- sensors without any error would raise χ² by ``ĉᵀC⁻¹ĉ``; if only those of the channels in R had none, by
  ``ĉ_Rᵀ(C_RR)⁻¹ĉ_R``;
- the data alone have the information ``I = C⁻¹ − P⁻¹`` about c, and the score ``h = C⁻¹ĉ`` at c = 0. With
  calibrations of another covariance P' the least χ² is ``hᵀ(I⁺ − (I + P'⁻¹)⁻¹)h`` above that with free ones.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.chi_square import chi2_tail
from rigctl.analysis.decision_levels import ALPHA
from rigctl.model.fit.fit import FitResult
from rigctl.model.reading_errors import ReadingError
from rigctl.units import parse_unit, show

Floats = NDArray[np.float64]

#: an error beyond this many times what is stated, by a standard deviation at least, contradicts it
_BEYOND = 1.15
#: shares of the stated uncertainty at which a better calibration is tried
_SHARES = (0.5, 0.3, 0.2, 0.1, 0.05, 0.02)


@dataclass(frozen=True)
class Misreading:
    """The error that a fit found of one channel's calibration, SI.

    Attributes
    ----------
    channel, unit: with its display unit.
    error: the largest over its readings, reading less true value; at the reading `at`.
    std: standard deviation of that error.
    stated: the uncertainty that the rig file states for it, 95 %.
    beyond: it contradicts what is stated.
    number: of the calibration, from 1, if the channel was calibrated anew.
    difference: the channel is a difference of temperatures.
    """

    channel: str
    unit: str
    error: float
    at: float
    std: float
    stated: float
    beyond: bool
    number: int = 1
    difference: bool = False

    @property
    def text(self) -> str:
        """``temperature_1 reads 0.8 K high at 55 degC (stated ±1 K)``."""
        size = show(abs(self.error), self.unit, difference=True, digits=2)
        at = show(self.at, self.unit, difference=self.difference, digits=2)
        stated = show(self.stated, self.unit, difference=True, digits=2)
        direction = "high" if self.error > 0.0 else "low"
        again = f" under its calibration {self.number}" if self.number > 1 else ""
        return f"{self.channel}{again} reads {size} {direction} at {at} (stated ±{stated})"

    def document(self) -> dict[str, Any]:
        """Its machine-readable form, in the channel's unit."""
        unit = parse_unit(self.unit)
        return {
            "channel": self.channel,
            "calibration": self.number,
            "error": self.error / unit.factor,
            "std": self.std / unit.factor,
            "stated": self.stated / unit.factor,
            "unit": "K" if unit.offset else self.unit,
            "at": unit.from_si(self.at, difference=self.difference),
            "beyond": self.beyond,
        }


@dataclass(frozen=True)
class SensorBudget:
    """The errors of all calibrations together, as a fit estimates them.

    Attributes
    ----------
    errors: the parts, in the order of the arrays.
    estimate, covariance: (c) and (c, c), SI.
    misreadings: of each channel.
    """

    errors: tuple[ReadingError, ...]
    estimate: Floats
    covariance: Floats
    misreadings: tuple[Misreading, ...]

    @property
    def beyond(self) -> tuple[Misreading, ...]:
        """Those that contradict what the rig file states."""
        return tuple(one for one in self.misreadings if one.beyond)

    @cached_property
    def matters(self) -> bool:
        """Whether exact sensors would leave significantly more misfit; a part at its bound always does."""
        if not np.all(np.diag(self.covariance) > 0.0):
            return True
        return self._raised_without(range(len(self.errors))) < ALPHA

    @cached_property
    def explaining(self) -> tuple[Misreading, ...]:
        """The channels whose errors are enough; the alternatives, if each of several is enough alone."""
        alone = [one for one in self.misreadings if self._raised_without(self._others(one)) >= ALPHA]
        if alone:
            return tuple(alone)
        needed = [one for one in self.misreadings if self._raised_without(self._of(one)) < ALPHA]
        return tuple(needed) or self.misreadings

    @property
    def alternatives(self) -> bool:
        """Whether each of `explaining` is enough alone."""
        first = self.explaining[0]
        return self._raised_without(self._others(first)) >= ALPHA

    @cached_property
    def explanation(self) -> str:
        """The errors in words: ``temperature_1 reads 0.8 K high at 55 degC (stated ±1 K)``."""
        between = " or " if self.alternatives else " and "
        return between.join(one.text for one in self.explaining)

    @cached_property
    def recalibration(self) -> tuple[str, ...]:
        """For each channel of `explaining`, the calibration that would decide between it and the model."""
        texts = []
        for one in self.explaining:
            share = self._deciding_share(one)
            if share:
                better = show(share * one.stated, one.unit, difference=True, digits=1)
                texts.append(
                    f"recalibrate {one.channel} to ±{better}: if its error is as small, something is "
                    "missing in the model; if not, it was the sensor"
                )
        return tuple(texts)

    def _deciding_share(self, misreading: Misreading) -> float:
        """The largest share of its stated uncertainty at which a right sensor leaves a misfit; 0 if none."""
        free = np.flatnonzero(np.diag(self.covariance) > 0.0)  # a part at its bound has none
        prior = np.array([self.errors[k].std for k in free])
        covariance = self.covariance[np.ix_(free, free)] / np.outer(prior, prior)  # in units of the priors
        inverse = np.linalg.pinv(covariance, hermitian=True)
        score = inverse @ (self.estimate[free] / prior)
        information = inverse - np.eye(prior.size)
        of = self._of(misreading)

        def left(share: float) -> float:
            weights = np.where(np.isin(free, of), 1.0 / share**2, 1.0)
            return -float(score @ np.linalg.solve(information + np.diag(weights), score))

        now = left(1.0)
        for share in _SHARES:
            if chi2_tail(left(share) - now, len(of)) < ALPHA:
                return share
        return 0.0

    def _of(self, misreading: Misreading) -> list[int]:
        return [
            k
            for k, one in enumerate(self.errors)
            if (one.channel, one.number) == (misreading.channel, misreading.number)
        ]

    def _others(self, misreading: Misreading) -> list[int]:
        return [
            k
            for k, one in enumerate(self.errors)
            if (one.channel, one.number) != (misreading.channel, misreading.number)
        ]

    def _raised_without(self, indices: Sequence[int]) -> float:
        """The probability that chance raises χ² as much if these parts are held at zero."""
        at = list(indices)
        if not at:
            return 1.0
        sizes = np.array([self.errors[k].std for k in at])
        inverse = np.linalg.pinv(self.covariance[np.ix_(at, at)] / np.outer(sizes, sizes), hermitian=True)
        scaled = self.estimate[at] / sizes
        return chi2_tail(float(scaled @ inverse @ scaled), len(at))


def sensor_budget(fit: FitResult) -> SensorBudget | None:
    """The errors of the calibrations in a fit; None if the rig file states no uncertainty of any."""
    errors = fit.problem.measurements.reading_errors
    solution = fit.solution
    if not errors or solution is None:
        return None
    names = [unknown.name for unknown in solution.unknowns]
    free = [one for one in errors if one.name in names]
    if not free:
        return None
    at = [names.index(one.name) for one in free]
    values = dict(zip((one.name for one in fit.problem.shared), fit.values, strict=True))
    estimate = np.array([float(values[one.name]) for one in free])
    covariance = solution.covariance[np.ix_(at, at)]
    read = {one.channel for one in free if _readings(fit, one.channel).size}
    calibrations = dict.fromkeys((one.channel, one.number) for one in free if one.channel in read)
    return SensorBudget(
        tuple(free),
        estimate,
        covariance,
        tuple(_misreading(fit, free, estimate, covariance, *one) for one in calibrations),
    )


def _misreading(
    fit: FitResult,
    errors: Sequence[ReadingError],
    estimate: Floats,
    covariance: Floats,
    channel: str,
    number: int,
) -> Misreading:
    at = [k for k, one in enumerate(errors) if (one.channel, one.number) == (channel, number)]
    readings = _readings(fit, channel)
    shapes = np.stack([errors[k].basis(readings) for k in at])
    curve = estimate[at] @ shapes
    worst = int(np.argmax(np.abs(curve)))
    shape = shapes[:, worst]
    prior = np.array([errors[k].std for k in at])
    std = math.sqrt(max(0.0, float(shape @ covariance[np.ix_(at, at)] @ shape)))
    # parts may come from one number, as zero and gain from a relative gain: at most they add up
    stated = errors[at[0]].whole or 2.0 * float(np.abs(shape) @ prior)
    error, value = float(curve[worst]), float(readings[worst])
    beyond = abs(error) > max(_BEYOND * stated, stated + std)
    rig = fit.problem.measurements.rig
    assert rig is not None  # noqa: S101 - calibrations are those of a rig file
    sensor = rig.channels[channel]
    return Misreading(channel, sensor.unit, error, value, std, stated, beyond, number, sensor.difference)


def _readings(fit: FitResult, channel: str) -> Floats:
    """(n) the readings of a channel, or of a measured input, in the fitted records."""
    measurements = fit.problem.measurements
    records = [measurements.records[k] for k in fit.fitted]
    if channel in measurements.outputs:
        k = measurements.outputs.index(channel)
        values = np.concatenate([record.values[:, k] for record in records])
    else:
        k = measurements.inputs.index(channel)
        values = np.concatenate([record.input_course(k) for record in records])
    good = np.asarray(values[np.isfinite(values)])
    if not good.size:
        return good
    low, high = float(good.min()), float(good.max())
    return np.linspace(low, high, 65) if high > low else np.array([low])
