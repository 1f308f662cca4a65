"""Is it the sensor or the model? What errors of calibrations and clocks explain, and which are too large.

The fit has the errors c of calibrations and clocks among its unknowns, with priors N(0, P) that the rig file
states (`rigctl.model.reading_errors`). With ĉ their estimates and C their covariance, everything else being
free, and as far as the problem is linear,

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

from rigctl.analysis.decision_levels import ALPHA
from rigctl.analysis.linear.chi_square import chi2_tail
from rigctl.model.fit.fit import FitResult
from rigctl.model.reading_errors import CALIBRATION, CLOCK, CalibrationError, ClockError, ReadingError
from rigctl.units import parse_unit

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
    def of(self) -> tuple[str, str, int]:
        """That of its unknowns."""
        return CALIBRATION, self.channel, self.number

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
class WrongClock:
    """The offset that a fit found of one clock, s, beyond the one that the rig file states.

    Attributes
    ----------
    clock, channels: its name, and what it dates.
    error: how far it is behind: its readings were taken later than they say.
    std: standard deviation of that offset.
    stated: the uncertainty that the rig file states for it, 95 %.
    beyond: it contradicts what is stated.
    number: from 1, if the rig file has changed what it says of the clock.
    offset: that the rig file states, s, beside which `error` is.
    """

    clock: str
    channels: tuple[str, ...]
    error: float
    std: float
    stated: float
    beyond: bool
    number: int = 1
    offset: float = 0.0

    @property
    def of(self) -> tuple[str, str, int]:
        """That of its unknown."""
        return CLOCK, self.clock, self.number

    def document(self) -> dict[str, Any]:
        """Its machine-readable form."""
        return {
            "clock": self.clock,
            "channels": list(self.channels),
            "behind": self.offset + self.error,
            **({"offset": self.offset} if self.offset else {}),
            "std": self.std,
            "stated": self.stated,
            "unit": "s",
            "beyond": self.beyond,
        }


@dataclass(frozen=True)
class Recalibration:
    """A calibration, or a measured offset of a clock, to this share of what is stated: as precise as decides
    between its `error` and the model."""

    error: Misreading | WrongClock
    share: float


@dataclass(frozen=True)
class SensorBudget:
    """The errors of all calibrations and clocks together, as a fit estimates them.

    Attributes
    ----------
    errors: the parts, in the order of the arrays.
    estimate, covariance: (c) and (c, c), SI.
    misreadings: of each channel and clock.
    """

    errors: tuple[ReadingError, ...]
    estimate: Floats
    covariance: Floats
    misreadings: tuple[Misreading | WrongClock, ...]

    @property
    def beyond(self) -> tuple[Misreading | WrongClock, ...]:
        """Those that contradict what the rig file states."""
        return tuple(one for one in self.misreadings if one.beyond)

    @property
    def misread(self) -> tuple[Misreading, ...]:
        """The channels among `beyond`."""
        return tuple(one for one in self.beyond if isinstance(one, Misreading))

    def kinds(self, of: Sequence[Misreading | WrongClock]) -> str:
        """What some of them are errors of: ``calibration``, ``clock``, or both."""
        between = " or " if of == self.explaining and self.alternatives else " and "
        return between.join(kind for kind in (CALIBRATION, CLOCK) if any(one.of[0] == kind for one in of))

    @cached_property
    def matters(self) -> bool:
        """Whether exact sensors would leave significantly more misfit; a part at its bound always does."""
        if not np.all(np.diag(self.covariance) > 0.0):
            return True
        return self._raised_without(range(len(self.errors))) < ALPHA

    @cached_property
    def explaining(self) -> tuple[Misreading | WrongClock, ...]:
        """Those whose errors are enough; the alternatives, if each of several is enough alone."""
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
    def recalibration(self) -> tuple[Recalibration, ...]:
        """For each of `explaining`, what would decide between it and the model."""
        shares = [(one, self._deciding_share(one)) for one in self.explaining]
        return tuple(Recalibration(one, share) for one, share in shares if share)

    def _deciding_share(self, misreading: Misreading | WrongClock) -> float:
        """The largest share of its stated uncertainty at which a right sensor leaves a misfit; 0 if none."""
        # From C and the priors back to what the data alone say: I = C⁻¹ − P⁻¹ and h = C⁻¹ĉ, all in units of
        # the priors' standard deviations. A calibration of the share s of what is stated has the prior s²:
        # least χ² as a function of s, without another fit.
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

    def _of(self, misreading: Misreading | WrongClock) -> list[int]:
        return [k for k, one in enumerate(self.errors) if one.of == misreading.of]

    def _others(self, misreading: Misreading | WrongClock) -> list[int]:
        return [k for k, one in enumerate(self.errors) if one.of != misreading.of]

    def _raised_without(self, indices: Sequence[int]) -> float:
        """The probability that chance raises χ² as much if these parts are held at zero."""
        at = list(indices)
        if not at:
            return 1.0
        sizes = np.array([self.errors[k].std for k in at])
        inverse = np.linalg.pinv(self.covariance[np.ix_(at, at)] / np.outer(sizes, sizes), hermitian=True)
        scaled = self.estimate[at] / sizes
        return chi2_tail(float(scaled @ inverse @ scaled), len(at))


def documents(budget: SensorBudget | None) -> dict[str, list[dict[str, Any]]]:
    """The errors of calibrations and of clocks in machine-readable form."""
    found = () if budget is None else budget.misreadings
    return {
        "sensors": [one.document() for one in found if isinstance(one, Misreading)],
        "clocks": [one.document() for one in found if isinstance(one, WrongClock)],
    }


def sensor_budget(fit: FitResult) -> SensorBudget | None:
    """The errors of calibrations and clocks in a fit; None if the rig file states no uncertainty of any."""
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
    found: list[Misreading | WrongClock] = []
    for of in dict.fromkeys(one.of for one in free):
        parts = [k for k, one in enumerate(free) if one.of == of]
        some, size, spread = [free[k] for k in parts], estimate[parts], covariance[np.ix_(parts, parts)]
        calibrated = [one for one in some if isinstance(one, CalibrationError)]
        if not calibrated:
            found += [_wrong_clock(one, size, spread) for one in some if isinstance(one, ClockError)]
        elif _readings(fit, calibrated[0].channel).size:
            found.append(_misreading(fit, calibrated, size, spread))
    return SensorBudget(tuple(free), estimate, covariance, tuple(found))


def _beyond(error: float, stated: float, std: float) -> bool:
    return abs(error) > max(_BEYOND * stated, stated + std)


def _wrong_clock(clock: ClockError, estimate: Floats, covariance: Floats) -> WrongClock:
    error, std = float(estimate[0]), math.sqrt(max(0.0, float(covariance[0, 0])))
    beyond = _beyond(error, clock.stated, std)
    return WrongClock(
        clock.clock, clock.channels, error, std, clock.stated, beyond, clock.number, clock.offset
    )


def _misreading(
    fit: FitResult, errors: Sequence[CalibrationError], estimate: Floats, covariance: Floats
) -> Misreading:
    """Of one calibration: its parts, their estimates and their covariance."""
    channel, number = errors[0].channel, errors[0].number
    # The error is a curve over the readings: it is judged where it is largest within those of the fitted
    # records, as one part (zero, gain, curvature) may make up for another.
    readings = _readings(fit, channel)
    shapes = np.stack([one.basis(readings) for one in errors])
    curve = estimate @ shapes
    worst = int(np.argmax(np.abs(curve)))
    shape = shapes[:, worst]
    prior = np.array([one.std for one in errors])
    std = math.sqrt(max(0.0, float(shape @ covariance @ shape)))
    # parts may come from one number, as zero and gain from a relative gain: at most they add up
    stated = errors[0].whole or 2.0 * float(np.abs(shape) @ prior)
    error, value = float(curve[worst]), float(readings[worst])
    beyond = _beyond(error, stated, std)
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
