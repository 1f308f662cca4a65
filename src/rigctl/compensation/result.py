"""A set-point schedule: what to set while the operating point drifts, how certain that is, and its range.

`Schedule` is what `rigctl.compensation.schedule` returns, for people and for programs, with the `Check`
by which it can be tested on the bench. The words are made in `rigctl.answers`.

Beside the schedule stands what a constant set-point would give, that of the middle of the range
(`fixed`): with it a check compares, as the best that a bench without a schedule could have. Rows that the
rig cannot reach are kept as NaN, and `RangeEnd` says what the quantity becomes there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

from rigctl.compensation.check import Check
from rigctl.notebook import as_html, documented, one_line, worded
from rigctl.units import parse_unit

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class CompensationRow:
    """What to set at one operating point, SI.

    Attributes
    ----------
    over: the operating point.
    vary: the set-point; NaN if it is beyond the rig's range.
    std: its standard deviation, due to the fitted parameters.
    kept: the resulting quantity, and `scatter` its standard deviation from record to record.
    fixed: the quantity with the set-point of the middle of the range.
    """

    over: float
    vary: float
    std: float
    kept: float
    scatter: float
    fixed: float

    @property
    def reached(self) -> bool:
        """Whether the rig can set it."""
        return math.isfinite(self.vary)


@dataclass(frozen=True)
class RangeEnd:
    """Where the rig's range is insufficient, SI.

    Attributes
    ----------
    at: the operating points at which the schedule ends.
    first, last: of those beyond, with the quantity that results there, `becomes`, at the end of the range.
    bound: the set-point at the `side` of the rig's range.
    """

    at: tuple[float, ...]
    first: float
    last: float
    bound: float
    side: Literal["lowest", "highest"]
    becomes: tuple[float, float]


@dataclass(frozen=True)
class Schedule:
    """A set-point over an operating variable that keeps a quantity at its target.

    Attributes
    ----------
    quantity, target: what is kept, SI, in `unit`.
    vary, over: names, with the units in which they are shown.
    rows: in the order of `over`.
    fixed: the set-point of the middle of the range, SI, used for comparison.
    off: the largest error from interpolation between two rows, SI, of the quantity.
    valid: (name, low, high, unit) ranges of the data, SI.
    ends: where and why the schedule ends.
    disagreement: the p-value of the model if it does not agree with the data.
    check: by randomised records.
    """

    runs: tuple[str, ...]
    model: str
    quantity: str
    target: float
    unit: str
    vary: str
    vary_unit: str
    over: str
    over_unit: str
    rows: tuple[CompensationRow, ...]
    fixed: float
    off: float
    valid: tuple[tuple[str, float, float, str], ...]
    ends: tuple[RangeEnd, ...]
    disagreement: float | None
    check: Check = field(repr=False)

    @property
    def reached(self) -> tuple[CompensationRow, ...]:
        """The rows that the rig can set."""
        return tuple(row for row in self.rows if row.reached)

    @property
    def off_if_fixed(self) -> float:
        """The largest error of the quantity at the fixed set-point, SI."""
        return max(abs(row.fixed - self.target) for row in self.reached)

    @property
    def scatter(self) -> float:
        """The largest standard deviation of the quantity from record to record, SI."""
        return max(row.scatter for row in self.reached)

    @property
    def statement(self) -> str:
        """The schedule in words."""
        return worded(self, "schedule.schedule.statement")

    def document(self) -> dict[str, Any]:
        """The machine-readable answer; numbers in the stated units."""
        return documented(self, "schedule_document")

    def numbers(self) -> list[dict[str, float | None]]:
        """The rows in the units in which they are shown; None where the rig does not reach."""
        q, v, o = self.unit, self.vary_unit, self.over_unit
        return [
            {
                "over": in_unit(row.over, o),
                "vary": in_unit(row.vary, v),
                "std": in_unit(row.std, v, interval=True),
                "kept": in_unit(row.kept, q),
                "scatter": in_unit(row.scatter, q, interval=True),
                "fixed": in_unit(row.fixed, q),
            }
            for row in self.rows
        ]

    def summary(self) -> str:
        """The schedule in a few lines."""
        return worded(self, "schedule.schedule.summary")

    def frame(self) -> pd.DataFrame:
        """One row for each operating point."""
        import pandas as pd

        return pd.DataFrame(self.numbers())

    def __repr__(self) -> str:
        """The schedule on one line."""
        return one_line(self, f"{self.vary} over {self.over}, {len(self.reached)} rows")

    def _repr_html_(self) -> str:
        """The summary and the rows, as a notebook shows them."""
        return as_html(self.summary(), self.frame())


def in_unit(si: float, unit: str, *, interval: bool = False) -> float | None:
    """A value in a unit; None for NaN."""
    value = parse_unit(unit).from_si(si, difference=interval) if math.isfinite(si) else math.nan
    return value if math.isfinite(value) else None
