"""A value that a step measured or an operator answered."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class MeasuredValue:
    """A value kept with a record or with the run: SI, with the unit for display and its limits.

    Attributes
    ----------
    value, low, high: SI; the limits are included.
    unit: the unit it is shown in.
    passed: whether it is within its limits.
    difference: whether it is a temperature interval, shown without offset.
    typed: whether it is an operator's answer: its limits restrict what may be typed, and judge nothing.
    path: of the step that took it, in the plan; "" if unknown.
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

    @property
    def judged(self) -> bool:
        """True if it has limits to be judged by."""
        return not self.typed and (self.low is not None or self.high is not None)
