"""The measures of the procedure, with their limits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rigctl.answers.numbers import amount, number, plural, with_unit
from rigctl.report.run_data import Measured, RunData
from rigctl.report.section import Section, cut, render
from rigctl.report.signals import plain_name, record_label


@dataclass(frozen=True)
class MeasureRow:
    """One value: `place` is its position between its limits, from 0 to 1, if it has both."""

    run: str
    record: str
    name: str
    value: str
    limits: str
    verdict: str  #: passed, missed, or nothing when there is no limit
    place: float | None


def build(runs: Sequence[RunData]) -> Section | None:
    """A table of all measures, those that missed their limits first; None when there are none."""
    rows = [row for run in runs for row in _rows(run)]
    if not rows:
        return None
    rows.sort(key=lambda row: row.verdict != "missed")
    shown, left_out = cut(rows)
    body = render("measures.html", rows=shown, left_out=left_out, several=len(runs) > 1)
    missed = sum(row.verdict == "missed" for row in rows)
    hint = f"{missed} of {len(rows)} outside their limits" if missed else plural(len(rows), "value")
    return Section("measures", "Measured values", body, folded=not missed, hint=hint)


def _rows(run: RunData) -> list[MeasureRow]:
    labels = {record.index: record_label(record) for record in run.records}
    return [
        MeasureRow(
            run=run.id,
            record=labels.get(measured.record, "whole run"),
            name=plain_name(measured.name),
            value=amount(measured.value, measured.unit),
            limits=limits(measured),
            verdict=("passed" if measured.passed else "missed") if measured.limited else "",
            place=_place(measured),
        )
        for measured in run.all_measures()
        if run.time.size or measured.limited  # the values of a table are shown as results
    ]


def limits(measured: Measured) -> str:
    """Limits in words: ``10 … 20 mm``, ``at least 10 mm``, ``at most 20 mm``."""
    if measured.low is not None and measured.high is not None:
        return with_unit(f"{number(measured.low)} … {number(measured.high)}", measured.unit)
    if measured.low is not None:
        return f"at least {amount(measured.low, measured.unit)}"
    if measured.high is not None:
        return f"at most {amount(measured.high, measured.unit)}"
    return ""


def _place(measured: Measured) -> float | None:
    """0 at the lower limit, 1 at the upper; outside them at most a fifth of the width away."""
    if measured.low is None or measured.high is None or measured.high <= measured.low:
        return None
    position = (measured.value - measured.low) / (measured.high - measured.low)
    return round(min(max(position, -0.2), 1.2), 4) if position == position else None  # noqa: PLR0124 - not for NaN
