"""All records: a table, and a plot of the selected one, with another for comparison."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from markupsafe import Markup

from rigctl.answers.numbers import decimals, duration, fixed, plural, setting, symbol
from rigctl.report.interactive_plots import arrays, embed, template
from rigctl.report.plot import Plot
from rigctl.report.run_data import COMPLETE, RecordData, RunData
from rigctl.report.section import Section, cut, render
from rigctl.report.signals import plain_name, record_label, record_plot, record_ranges
from rigctl.report.stroke import find_motion, stroke

#: values in all record plots together: 1.5 million are at most 8 MB of page; a usual campaign has a quarter
_MOST_VALUES = 600_000
_MOST_POINTS, _FEWEST_POINTS = 2000, 24


@dataclass(frozen=True)
class RecordRow:
    """A record in the table; `key` names its plot."""

    key: str
    label: str
    index: int
    name: str
    sweep: tuple[str, ...]
    start: str
    length: str
    stroke: str
    tone: str
    outcome: str
    excluded: str | None


@dataclass(frozen=True)
class RunRecords:
    """The records of one run as the template needs them."""

    id: str
    key: str
    sweep_heads: tuple[str, ...]
    stroke_head: str | None
    rows: tuple[RecordRow, ...]
    left_out: int
    template: Markup
    contents: tuple[tuple[str, Markup], ...]


def build(runs: Sequence[RunData]) -> Section | None:
    """Table and plots of the records of all runs; None when there are none."""
    values = sum(len(run.records) * len(run.signals) for run in runs)
    if not values:
        return None
    points = min(max(_MOST_VALUES // values, _FEWEST_POINTS), _MOST_POINTS)
    parts, plots = [], []
    for number_of_run, run in enumerate(runs):
        if run.records and run.signals:  # a table of single values has rows, and nothing over time
            part, drawn = _run_records(run, f"r{number_of_run}", points)
            parts.append(part)
            plots.extend(drawn)
    body = render("records.html", runs=parts, several=len(parts) > 1)
    hint = plural(sum(len(part.rows) + part.left_out for part in parts), "record")
    return Section("records", "Records", body, tuple(plots), hint=hint)


def _run_records(run: RunData, key: str, points: int) -> tuple[RunRecords, list[Plot]]:
    ranges = record_ranges(run)
    shown, left_out = cut(run.records)
    keys = [f"{key}-{record.index}" for record in shown]
    plots = [
        record_plot(run, record, points=points, key=f"record-{name}", ranges=ranges)
        for record, name in zip(shown, keys, strict=True)
    ]
    sweeps = list(dict.fromkeys(name for record in shown for name in record.sweep))
    units = {name: unit for record in shown for name, (_, unit) in record.sweep.items()}
    strokes, stroke_head = _strokes(run, shown)
    part = RunRecords(
        id=run.id,
        key=key,
        sweep_heads=tuple(_head(name, units[name]) for name in sweeps),
        stroke_head=stroke_head,
        rows=tuple(
            _row(name, record, sweeps, distance)
            for name, record, distance in zip(keys, shown, strokes, strict=True)
        ),
        left_out=left_out,
        template=embed(template(plots[0])),
        contents=tuple((name, embed(arrays(plot))) for name, plot in zip(keys, plots, strict=True)),
    )
    return part, plots


def _strokes(run: RunData, records: Sequence[RecordData]) -> tuple[list[str], str | None]:
    """The stroke of each record as text, and the column's heading; None if no record has one."""
    motion = find_motion(run)
    strokes = [None if motion is None else stroke(run, record, motion) for record in records]
    present = [value for value in strokes if value is not None]
    if motion is None or not present:
        return [""] * len(records), None
    digits = decimals(present)
    return [fixed(value, digits) for value in strokes], _head("stroke", motion.position.unit)


def _head(name: str, unit: str) -> str:
    return f"{plain_name(name)} [{symbol(unit)}]" if symbol(unit) else plain_name(name)


def _row(key: str, record: RecordData, sweeps: Sequence[str], distance: str) -> RecordRow:
    values = [record.sweep.get(name) for name in sweeps]
    return RecordRow(
        key=key,
        label=record_label(record),
        index=record.index,
        name=record.name,
        sweep=tuple("" if value is None else setting(value[0]) for value in values),
        start=duration(record.start),
        length=duration(record.end - record.start),
        stroke=distance,
        tone="good" if record.outcome == COMPLETE else "bad",
        outcome=record.outcome.replace("_", " "),
        excluded=record.excluded,
    )
