"""Errors of calibrations and clocks in words: how wrong each is, and what would decide whether it is."""

from __future__ import annotations

from collections.abc import Sequence

from rigctl.analysis.agreement.sensors import Misreading, SensorBudget, WrongClock
from rigctl.model.reading_errors import CALIBRATION, CLOCK
from rigctl.units import show


def error_text(one: Misreading | WrongClock) -> str:
    """``temperature_1 reads 0.8 K high at 55 degC (stated ±1 K)``."""
    if isinstance(one, WrongClock):
        return _clock_text(one)
    size = show(abs(one.error), one.unit, difference=True, digits=2)
    at = show(one.at, one.unit, difference=one.difference, digits=2)
    stated = show(one.stated, one.unit, difference=True, digits=2)
    direction = "high" if one.error > 0.0 else "low"
    again = f" under its calibration {one.number}" if one.number > 1 else ""
    return f"{one.channel}{again} reads {size} {direction} at {at} (stated ±{stated})"


def _clock_text(one: WrongClock) -> str:
    """``the clock logger_b is 32 ms behind (stated ±50 ms)``."""
    unit = _unit_of(one)
    whole = one.offset + one.error
    size, stated = show(abs(whole), unit, digits=2), show(one.stated, unit, digits=2)
    direction = "behind" if whole > 0.0 else "ahead"
    again = f" under its statement {one.number}" if one.number > 1 else ""
    known = f"{show(one.offset, unit, digits=2)} " if one.offset else ""
    return f"the clock {one.clock}{again} is {size} {direction} (stated {known}±{stated})"


def _unit_of(clock: WrongClock) -> str:
    return "ms" if clock.stated < 1.0 else "s"


def remedy_text(one: Misreading | WrongClock, share: float) -> str:
    """What decides between it and the model: a calibration to this share of what is stated, or the like."""
    if isinstance(one, WrongClock):
        better = show(share * one.stated, _unit_of(one), digits=1)
        return (
            f"measure the offset of the clock {one.clock} to ±{better}, by an edge that it and the commands "
            "both date: if it is as small, something is missing in the model; if not, it was the clock"
        )
    better = show(share * one.stated, one.unit, difference=True, digits=1)
    return (
        f"recalibrate {one.channel} to ±{better}: if its error is as small, something is "
        "missing in the model; if not, it was the sensor"
    )


def beyond_text(budget: SensorBudget) -> str:
    """``temperature_1 reads 1.5 K high at 55 degC (stated ±1 K), more than its calibration allows``."""
    clocks = len(budget.misread) < len(budget.beyond)
    return f"{_joined(budget.beyond)}, more than {'is stated' if clocks else 'its calibration allows'}"


def explanation(budget: SensorBudget) -> str:
    """The errors that explain what a model leaves, or that each explain it alone."""
    return _joined(budget.explaining, " or " if budget.alternatives else " and ")


def _joined(errors: Sequence[Misreading | WrongClock], between: str = " and ") -> str:
    return between.join(map(error_text, errors))


def exact_text(budget: SensorBudget) -> str:
    """What would be exact without the errors that explain something: ``sensors``, ``clocks``, or both."""
    kinds = {one.of[0] for one in budget.explaining}
    return "sensors" + " and clocks" * (CLOCK in kinds) if CALIBRATION in kinds else "clocks"
