"""How wrong calibrations and clocks may be, as unknowns that all records under them have in common.

A calibration is a measurement, and uncertain as a whole: each reading of a channel is
``r = y + Σ_k c_k·b_k(y)``, y the true value, with

    b = 1                   its zero,
    b = x                   its gain,
    b = (3·x² − 1)/2        its curvature,      x = (y − middle)/half.

`middle` and `half` are those of the channel's readings in all records, so that each c_k is an error in the
unit of the channel, the largest that its part makes. Every c_k has the prior N(0, std): the rig file states
95 %, two standard deviations. Noise averages out over readings; these do not, whatever their number.

A clock that is behind by τ gives a reading at t + τ the time t: ``r(t) = y(t + τ)`` for every channel that it
dates, with the prior N(offset, std). Records are read at the times that the stated offset gives
(`rigctl.model.measured.offsets`), so that the unknown is what is left of τ, with the prior N(0, std) too.
Source: JCGM 100:2008 (GUM), 3.2 and F.2.4.5, systematic effects of a calibration.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from rigctl.effects.declaration import Effect, EffectParameter, qualified
from rigctl.engine.least_squares import Prior, Unknown
from rigctl.engine.symbols import Scalar, constant_like
from rigctl.physics.family import ModelFamily
from rigctl.physics.si_unit import si_unit
from rigctl.rig.channel import Channel
from rigctl.rig.clock import Clock

Floats = NDArray[np.float64]
T = TypeVar("T")

#: the effects whose parameters are the errors of all calibrations, and the offsets of all clocks
CALIBRATION, CLOCK = "calibration", "clock"
#: an error is no larger than this many standard deviations of its prior, twice what is
#: stated: a wrong model would otherwise have its sensors wrong by more than anybody could overlook
_FAR = 4.0
#: a calibration's error changes by what is stated over no less than this share of the channel's range
_LEAST_SPAN = 0.1


class _CommonError(ABC):
    """One unknown of a calibration or a clock, common to all records under it.

    Attributes
    ----------
    std: of its prior, SI.
    unit: of the unknown, SI.
    runs: those recorded under this calibration or clock; empty for all.
    latest: it is the last one, under which further records would be made.
    """

    std: float
    unit: str
    runs: tuple[str, ...]
    latest: bool

    @property
    @abstractmethod
    def name(self) -> str:
        """Its name as an unknown: that of an effect, and of a parameter of it."""

    @property
    @abstractmethod
    def of(self) -> tuple[str, str, int]:
        """What is wrong: `CALIBRATION` and a channel, or `CLOCK` and its name; and its number, from 1."""

    @property
    def source(self) -> str:
        """What is wrong, in words, whatever its number."""
        kind, name, _ = self.of
        return f"calibration of {name}" if kind == CALIBRATION else f"clock {name}"

    @property
    def unknown(self) -> Unknown:
        """The unknown, with its prior."""
        reach = _FAR * self.std
        return Unknown(
            self.name, 0.0, -reach, reach, scale=self.std, prior=Prior(0.0, self.std), unit=self.unit
        )

    def acts_in(self, run: str) -> bool:
        """Whether the records of a run were made under it; "" for records still to be made."""
        return not self.runs or run in self.runs or (not run and self.latest)


@dataclass(frozen=True)
class ClockError(_CommonError):
    """What is left of the offset of one clock, s: its readings were taken at t + τ, later than they say if it
    is behind, t being what it says corrected by `offset`.

    Attributes
    ----------
    clock: its name.
    channels: that it dates, of those that the records have.
    number: from 1, where the rig file has changed what it says of the clock.
    known: the rig file says that it may be off.
    offset: that the rig file states, the centre of the prior of the whole, s.
    """

    clock: str
    channels: tuple[str, ...]
    std: float
    unit: str = "s"
    runs: tuple[str, ...] = ()
    number: int = 1
    latest: bool = True
    known: Literal[True] = True
    offset: float = 0.0

    @property
    def name(self) -> str:
        """Its name as an unknown."""
        # no name in a rig file begins with a digit: that of another clock is always another one
        return qualified(CLOCK, (f"{self.number}_" if self.number > 1 else "") + self.clock)

    @property
    def of(self) -> tuple[str, str, int]:
        """`CLOCK`, its name and its number."""
        return CLOCK, self.clock, self.number

    @property
    def stated(self) -> float:
        """What the rig file states, 95 %, s."""
        return 2.0 * self.std

    @property
    def largest(self) -> float:
        """The largest offset that a fit may find, s."""
        return _FAR * self.std


@dataclass(frozen=True)
class CalibrationError(_CommonError):
    """One part of the error of one calibration.

    Attributes
    ----------
    channel: that it belongs to.
    part: "zero", "gain" or "linearity".
    std: of its prior, in the channel's SI unit.
    middle, half: see the module.
    number: of the calibration, from 1, where a channel has more than one.
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
    def name(self) -> str:
        """Its name as an unknown."""
        return qualified(CALIBRATION, f"{self.channel}_{self.part}" + _numbered(self.number))

    @property
    def of(self) -> tuple[str, str, int]:
        """`CALIBRATION`, its channel and its number."""
        return CALIBRATION, self.channel, self.number

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


ReadingError: TypeAlias = CalibrationError | ClockError


def calibration_errors(
    channels: Mapping[str, Mapping[str, Channel]], readings: Mapping[str, Floats], *, rows: bool = False
) -> tuple[CalibrationError, ...]:
    """The errors of the calibrations of these channels, as far as their uncertainty is stated.

    Parameters
    ----------
    channels: of each run, as they were when it was recorded, in the order of the runs.
    readings: of each channel in all records, SI.
    rows: the readings are single values of a table, of which many are differences: an error of the zero
        cancels, and gain and curvature count from zero.
    """
    errors: list[CalibrationError] = []
    for name, values in readings.items():
        # one unknown for each part of each calibration: a channel that was calibrated between runs has two of
        # everything, and each acts in its own runs
        good = values[np.isfinite(values)]
        calibrations = _calibrations(name, channels) if good.size else []
        for number, (channel, runs) in enumerate(calibrations, 1):
            middle, half = _span(channel, good, rows=rows)
            last = number == len(calibrations)
            known = channel.calibration.known_parts
            errors += [
                CalibrationError(
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
    # without a range, from the zero of the channel's unit (0 degC is 273.15 K) to the farthest reading
    origin = channel.display.to_si(0.0, difference=channel.difference)
    reach = channel.width or 2.0 * max(abs(low - origin), abs(high - origin))
    return 0.5 * (low + high), 0.5 * max(high - low, _LEAST_SPAN * reach)


def _calibrations(
    name: str, channels: Mapping[str, Mapping[str, Channel]]
) -> list[tuple[Channel, tuple[str, ...]]]:
    """The states of a channel's calibration, each with its runs; without names if it was never changed."""
    states = _states({run: of_run[name] for run, of_run in channels.items() if name in of_run}, _calibrated)
    return [(channel, runs if len(states) > 1 else ()) for channel, runs in states]


def _calibrated(channel: Channel) -> object:
    return channel.calibration, channel.range


def clock_errors(
    clocks: Mapping[str, Mapping[str, Clock]], channels: Collection[str]
) -> tuple[ClockError, ...]:
    """The offsets of the clocks that date some of these channels.

    Parameters
    ----------
    clocks: of each run, as they were when it was recorded, in the order of the runs.
    """
    errors = []
    for name in dict.fromkeys(name for of_run in clocks.values() for name in of_run):
        states = _states({run: of_run[name] for run, of_run in clocks.items() if name in of_run}, _statement)
        # runs are named only where it matters: without names an error acts in every run, also in those still
        # to come
        everywhere = len(states) == 1 and len(states[0][1]) == len(clocks)
        for number, (clock, runs) in enumerate(states, 1):
            dated = tuple(one for one in clock.channels if one in channels)
            if dated:
                errors.append(
                    ClockError(
                        name,
                        dated,
                        0.5 * clock.uncertainty,
                        runs=() if everywhere else runs,
                        number=number,
                        latest=list(clocks)[-1] in runs,
                        offset=clock.offset,
                    )
                )
    return tuple(errors)


def _statement(clock: Clock) -> object:
    return frozenset(clock.channels), clock.offset, clock.uncertainty


def _states(of_runs: Mapping[str, T], key: Callable[[T], object]) -> list[tuple[T, tuple[str, ...]]]:
    """What differs by `key`, each with its runs, in their order."""
    known: list[tuple[T, list[str]]] = []
    for run, one in of_runs.items():
        runs = next((runs for other, runs in known if key(other) == key(one)), None)
        if runs is None:
            known.append((one, [run]))
        else:
            runs.append(run)
    return [(one, tuple(runs)) for one, runs in known]


def error_effects(family: ModelFamily, errors: Sequence[ReadingError]) -> tuple[Effect, ...]:
    """The errors as parameters of a system: those of calibrations, and those of clocks.

    Only those of inputs' calibrations are in its equations. Their sizes are those of the unknowns: a system
    is the same for all runs with errors of these names, and compiled once.
    """
    effects = (
        (CALIBRATION, "Errors of calibrations.", "r = y + Σ_k c_k·b_k(y)",
         "A channel reads too high or too low, in all records alike."),
        (CLOCK, "Offsets of clocks.", "r(t) = y(t + τ)",
         "Some channels are late, or early, by the same in all records."),
    )  # fmt: skip
    return tuple(
        Effect(
            name=name,
            family=family.name,
            summary=summary,
            equation=equation,
            source="JCGM 100:2008 (GUM)",
            looks_like=looks_like,
            parameters=tuple(
                EffectParameter(
                    one.name.partition(".")[2], one.unit, 0.0, 1.0, -math.inf, math.inf,
                    f"error of the {one.source}", difference=True,
                )
                for one in errors
                if one.of[0] == name
            ),
            own_family=family,
        )
        for name, summary, equation, looks_like in effects
        if any(one.of[0] == name for one in errors)
    )  # fmt: skip


def _numbered(number: int) -> str:
    return f"_{number}" if number > 1 else ""


def true_input(value: Scalar, errors: Sequence[CalibrationError], known: Mapping[str, Scalar]) -> Scalar:
    """The true value of an input of which `value` was read, to first order in the errors."""
    for one in errors:
        value = value - known[one.name] * one.symbolic(value)
    return value
