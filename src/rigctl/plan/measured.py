"""What a step measured or was answered."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class MeasuredValue:
    """A value kept with a record or with the run: SI, with the unit it is shown in and its limits.

    Attributes
    ----------
    value, low, high: SI; the limits are included.
    unit: the unit it is shown in.
    passed: it is within its limits.
    difference: it is an interval of temperatures, shown without offset.
    """

    name: str
    value: float
    unit: str
    low: float | None = None
    high: float | None = None
    passed: bool = True
    difference: bool = False
