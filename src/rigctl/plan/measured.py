"""A value that was measured by a step or entered by an operator."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class MeasuredValue:
    """A value stored with a record or with the run, with its unit for display and its limits.

    Attributes
    ----------
    value, low, high: SI; the limits are inclusive.
    unit: the unit in which it is shown.
    passed: whether it is within its limits.
    difference: whether it is a temperature interval, shown without offset.
    typed: whether it is an operator's answer: its limits only restrict what may be typed, and test nothing.
    path: path in the plan of the step that produced it; "" if unknown.
    missing: share of the readings it was taken from that had no value.
    """

    name: str
    value: float
    unit: str
    low: float | None = None
    high: float | None = None
    passed: bool = True
    difference: bool = False
    typed: bool = False
    path: str = ""
    missing: float = 0.0

    @property
    def judged(self) -> bool:
        """True if it is a measure that has limits, and therefore passes or fails."""
        return not self.typed and (self.low is not None or self.high is not None)
