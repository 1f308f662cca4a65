"""How wrong the calibration of each channel may be, as unknowns that all records under it have in common.

A calibration is a measurement, and uncertain as a whole: each reading of a channel is
``r = y + Σ_k c_k·b_k(y)``, y the true value, with

    b = 1                   its zero,
    b = x                   its gain,
    b = (3·x² − 1)/2        its curvature,      x = (y − middle)/half.

`middle` and `half` are those of the channel's readings in all records, so that each c_k is an error in the
unit of the channel, the largest that its part makes. Every c_k has the prior N(0, std): the rig file states
95 %, two standard deviations. Noise averages out over readings; these do not, whatever their number.
Source: JCGM 100:2008 (GUM), 3.2 and F.2.4.5, systematic effects of a calibration.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.effects.declaration import Effect, EffectParameter, qualified
from rigctl.engine.least_squares import Prior, Unknown
from rigctl.engine.symbols import Scalar, constant_like
from rigctl.physics.family import ModelFamily
from rigctl.physics.si_unit import si_unit
from rigctl.rig.channel import Channel

Floats = NDArray[np.float64]

#: the effect whose parameters are the errors of all calibrations
CALIBRATION = "calibration"
#: an error of a calibration is no larger than this many standard deviations of its prior, twice what is
#: stated: a wrong model would otherwise have its sensors wrong by more than anybody could overlook
_FAR = 4.0
#: a calibration's error changes by what is stated over no less than this share of the channel's range
_LEAST_SPAN = 0.1


@dataclass(frozen=True)
class ReadingError:
    """One part of the error of one calibration.

    Attributes
    ----------
    channel: that it belongs to.
    part: "zero", "gain" or "linearity".
    std: of its prior, in the channel's SI unit.
    middle, half: see the module.
    unit: SI unit of the channel.
    runs: those recorded under this calibration; empty for all.
    number: of the calibration, from 1, where a channel has more than one.
    latest: it is the last one, under which further records would be made.
    whole: the uncertainty of a reading, 95 %, SI, if the rig file states no part of it; else 0.
    known: the rig file says that this part may be wrong; else only that the calibration may be.
    """

    channel: str
    part: str
    std: float
    middle: float
    half: float
    unit: str
    runs: tuple[str, ...] = ()
    number: int = 1
    latest: bool = True
    whole: float = 0.0
    known: bool = True

    @property
    def parameter(self) -> str:
        """Its name as a parameter of the effect `CALIBRATION`."""
        return f"{self.channel}_{self.part}" + (f"_{self.number}" if self.number > 1 else "")

    @property
    def name(self) -> str:
        """Its name as an unknown."""
        return qualified(CALIBRATION, self.parameter)

    @property
    def unknown(self) -> Unknown:
        """The unknown, with its prior."""
        reach = _FAR * self.std
        return Unknown(
            self.name, 0.0, -reach, reach, scale=self.std, prior=Prior(0.0, self.std), unit=self.unit
        )

    def acts_in(self, run: str) -> bool:
        """Whether the records of a run were made under this calibration; "" for records still to be made."""
        return not self.runs or run in self.runs or (not run and self.latest)

    def basis(self, value: Floats) -> Floats:
        """b(y): the error of a reading of `value`, per unit of the unknown."""
        if self.part == "zero":
            return np.ones_like(value)
        x = (value - self.middle) / self.half
        return x if self.part == "gain" else 1.5 * x * x - 0.5

    def symbolic(self, value: Scalar) -> Scalar:
        """`basis` in an equation."""
        if self.part == "zero":
            return 1.0
        x = (value - constant_like(self.middle, value)) / constant_like(self.half, value)
        return x if self.part == "gain" else 1.5 * x * x - 0.5

    def slope(self, value: Floats) -> Floats:
        """db/dy."""
        if self.part == "zero":
            return np.zeros_like(value)
        if self.part == "gain":
            return np.full_like(value, 1.0 / self.half)
        return 3.0 * (value - self.middle) / self.half**2


def reading_errors(
    channels: Mapping[str, Mapping[str, Channel]], readings: Mapping[str, Floats], *, rows: bool = False
) -> tuple[ReadingError, ...]:
    """The errors of the calibrations of these channels, as far as their uncertainty is stated.

    Parameters
    ----------
    channels: of each run, as they were when it was recorded, in the order of the runs.
    readings: of each channel in all records, SI.
    rows: the readings are single values of a table, of which many are differences: an error of the zero
        cancels, and gain and curvature count from zero.
    """
    errors: list[ReadingError] = []
    for name, values in readings.items():
        good = values[np.isfinite(values)]
        calibrations = _calibrations(name, channels) if good.size else []
        for number, (channel, runs) in enumerate(calibrations, 1):
            middle, half = _span(channel, good, rows=rows)
            last = number == len(calibrations)
            known = channel.calibration.known_parts
            errors += [
                ReadingError(
                    name,
                    part,
                    0.5 * size,
                    middle,
                    half or 1.0,
                    si_unit(channel.unit),
                    runs,
                    number,
                    last,
                    0.0 if channel.calibration.states_parts else channel.uncertainty,
                    known,
                )
                for part, size in channel.reading_uncertainty(middle, half).items()
                if size > 0.0 and (part == "zero" or half > 0.0) and not (rows and part == "zero")
            ]
    return tuple(errors)


def _span(channel: Channel, readings: Floats, *, rows: bool) -> tuple[float, float]:
    """The middle of the readings and half their width, which is a tenth of the channel's range at least.

    A gain that was wrong by all of what is stated over readings that hardly moved would be no gain.
    """
    low, high = float(readings.min()), float(readings.max())
    if rows:
        return 0.0, max(abs(low), abs(high))
    origin = channel.display.to_si(0.0, difference=channel.difference)
    reach = channel.width or 2.0 * max(abs(low - origin), abs(high - origin))
    return 0.5 * (low + high), 0.5 * max(high - low, _LEAST_SPAN * reach)


def _calibrations(
    name: str, channels: Mapping[str, Mapping[str, Channel]]
) -> list[tuple[Channel, tuple[str, ...]]]:
    """The states of a channel's calibration, each with its runs; without names if it was never changed."""
    known: list[tuple[Channel, list[str]]] = []
    for run, of_run in channels.items():
        channel = of_run.get(name)
        if channel is None:
            continue
        same = (
            runs
            for one, runs in known
            if (one.calibration, one.range) == (channel.calibration, channel.range)
        )
        runs = next(same, None)
        if runs is None:
            known.append((channel, [run]))
        else:
            runs.append(run)
    return [(channel, tuple(runs) if len(known) > 1 else ()) for channel, runs in known]


def calibration_effect(family: ModelFamily, errors: Sequence[ReadingError]) -> Effect:
    """The errors as parameters of a system; those of outputs act on its readings, not in its equations.

    Their sizes are those of the unknowns: a system is the same for all runs with errors of these names, and
    compiled once.
    """
    return Effect(
        name=CALIBRATION,
        family=family.name,
        summary="Errors of calibrations.",
        equation="r = y + Σ_k c_k·b_k(y)",
        source="JCGM 100:2008 (GUM)",
        looks_like="A channel reads too high or too low, in all records alike.",
        parameters=tuple(
            EffectParameter(one.parameter, one.unit, 0.0, 1.0, -math.inf, math.inf,
                            f"error of the {one.part} of {one.channel}", difference=True)
            for one in errors
        ),
        own_family=family,
    )  # fmt: skip


def true_input(value: Scalar, errors: Sequence[ReadingError], known: Mapping[str, Scalar]) -> Scalar:
    """The true value of an input of which `value` was read, to first order in the errors."""
    for one in errors:
        value = value - known[one.name] * one.symbolic(value)
    return value
