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
    typed: an operator's answer: its limits are those of what is taken for one, and judge nothing.
    path: of the step that it was taken by, in the plan; "" where it is not known.
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
        """True when it has limits that it passes or misses."""
        return not self.typed and (self.low is not None or self.high is not None)
