"""A set-point schedule: what to set while the operating point drifts, how certain that is, and its range."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from rigctl.notebook import as_html, one_line
from rigctl.units import parse_unit, show

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
    ends: where and why the schedule ends, a sentence each.
    called: path of the procedure that makes one record.
    procedure: text of the check by randomised records, which calls it; "" if there is none.
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
    ends: tuple[str, ...]
    statement: str
    notes: tuple[str, ...] = ()
    called: str = ""
    procedure: str = field(default="", repr=False)

    @property
    def reached(self) -> tuple[CompensationRow, ...]:
        """The rows that the rig can set."""
        return tuple(row for row in self.rows if row.reached)

    def document(self) -> dict[str, Any]:
        """The machine-readable answer; numbers in the stated units."""
        q, v, o = self.unit, self.vary_unit, self.over_unit
        return {
            "runs": list(self.runs),
            "model": self.model,
            "quantity": self.quantity,
            "target": _in(self.target, q),
            "unit": q,
            "vary": self.vary,
            "vary_unit": v,
            "over": self.over,
            "over_unit": o,
            "rows": [
                {
                    "over": _in(row.over, o),
                    "vary": _in(row.vary, v),
                    "std": _in(row.std, v, interval=True),
                    "kept": _in(row.kept, q),
                    "scatter": _in(row.scatter, q, interval=True),
                    "fixed": _in(row.fixed, q),
                }
                for row in self.rows
            ],
            "fixed": _in(self.fixed, v),
            "interpolation_error": _in(self.off, q, interval=True),
            "valid": [
                {"name": name, "low": _in(low, unit), "high": _in(high, unit), "unit": unit}
                for name, low, high, unit in self.valid
            ],
            "ends": list(self.ends),
            "procedure": self.procedure or None,
            "statement": self.statement,
            "notes": list(self.notes),
        }

    def summary(self) -> str:
        """The schedule in a few lines."""
        lines = [self.statement]
        lines += [
            f"  {self.over} {show(row.over, self.over_unit)}: {self.vary} {show(row.vary, self.vary_unit)}"
            for row in self.reached
        ]
        return "\n".join(lines)

    def frame(self) -> pd.DataFrame:
        """One row for each operating point."""
        import pandas as pd

        return pd.DataFrame(self.document()["rows"])

    def __repr__(self) -> str:
        """The schedule on one line."""
        return one_line(self, f"{self.vary} over {self.over}, {len(self.reached)} rows")

    def _repr_html_(self) -> str:
        """The summary and the rows, as a notebook shows them."""
        return as_html(self.summary(), self.frame())


def _in(si: float, unit: str, *, interval: bool = False) -> float | None:
    value = parse_unit(unit).from_si(si, difference=interval) if math.isfinite(si) else math.nan
    return value if math.isfinite(value) else None
