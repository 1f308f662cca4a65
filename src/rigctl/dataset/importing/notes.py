"""Remarks on a file that is valid but has something noteworthy."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Final

from rigctl.dataset.importing.cells.headings import time_unit
from rigctl.dataset.importing.cells.labels import describe_label
from rigctl.dataset.importing.cells.sentinels import MARKS
from rigctl.dataset.importing.columns import LEAVE_OUT, Assigned
from rigctl.dataset.importing.first_pass import Span, Survey
from rigctl.dataset.importing.formats.table import Heading
from rigctl.dataset.importing.options import Options
from rigctl.dataset.importing.samples import copies_in
from rigctl.dataset.standstill import standstill_remark
from rigctl.units import parse_unit, show

if TYPE_CHECKING:
    from rigctl.rig import Rig
    from rigctl.rig.layout import Layout

#: this many identical values are not a coincidence
_MANY: Final = 10


def notes(result: Survey, layout: Layout, rig: Rig, assumed: Mapping[str, float]) -> Iterator[str]:
    """Return remarks on channels that are absent, constant or incomplete, and on gaps in time."""
    yield from _absent(layout, rig, assumed)
    yield from impossible_notes(result, rig)
    for name, span in result.spans.items():
        if name in layout.channels:
            yield from _channel_notes(name, span, result.rows - result.impossible.get(name, 0), layout)
        yield from _mark_notes(name, span, layout)
    labels = [describe_label(record.label) for record in result.records]
    for name, stretches in result.standstills.items():
        remark = standstill_remark(
            name,
            stretches,
            partial(show, unit=layout.unit(name), difference=name in layout.differences),
            [f" in {label}" if len(labels) > 1 else "" for label in labels],
        )
        yield f"{remark}: was the sensor stuck?"
    for copy, original in copies_in(result):
        yield f"{copy} has the same samples as {original}: an analysis counts them once"
    broken = [record for record in result.records if record.gap is not None]
    if broken:
        worst = max(broken, key=lambda record: record.gap.length if record.gap else 0.0)
        assert worst.gap is not None  # noqa: S101 - of those that have one
        yield (
            f"gaps in time in {len(broken)} of {len(result.records)} records; the longest: "
            f"{worst.gap.length:.4g} s from {worst.gap.start:.6g} s on in "
            f"{describe_label(worst.label)}. '--split gap' makes a record of each stretch"
        )


def column_notes(
    headings: Sequence[Heading], assigned: Sequence[Assigned], options: Options
) -> Iterator[str]:
    """Return remarks on columns of samples that are not used although nobody said so, and on times without a
    unit.
    """
    time = next((column for column in assigned if column.kind == "time"), None)
    if time is None:
        return
    written = headings[time.index]
    named = options.unit_of(written.name) or written.unit or time_unit(written.name, None)[1]
    if not (named or written.seconds):
        yield (
            f"{written.name}: the times have no unit and are taken as seconds; "
            f"--columns '{written.name}=time [ms]' would say otherwise"
        )
    used = {column.index for column in assigned}
    for index, heading in enumerate(headings):
        said = options.ours(heading.name) == LEAVE_OUT or options.split == f"column:{heading.name}"
        if index in used or heading.spent or said or not heading.name:
            continue
        reason = "has no numbers" if not time_unit(heading.name, heading.unit)[0] else "is another time"
        yield f"{heading.name}: it {reason} and is left out"


def _absent(layout: Layout, rig: Rig, assumed: Mapping[str, float]) -> Iterator[str]:
    channels = [name for name in rig.channels if name not in layout.columns and name not in assumed]
    if channels:
        them = "it" if len(channels) == 1 else "them"
        yield f"not in the file: {', '.join(channels)}; no model is judged by {them}"
    commands = [name for name in rig.actuators if name not in layout.columns and name not in assumed]
    if commands:
        rest = "=off" if rig.actuators[commands[0]].kind == "switch" else "=VALUE"
        yield (
            f"not in the file: {', '.join(commands)}; if {'it' if len(commands) == 1 else 'one of them'} "
            f"stayed at one value, say so: --assume {commands[0]}{rest}"
        )
    for name, value in assumed.items():
        unit = _unit_on(name, rig)
        yield f"assumed: {name} {show(value, unit) if unit else f'{value:.6g} (SI)'}, throughout"


def _unit_on(name: str, rig: Rig) -> str:
    """Return the unit of a name on the bench, "" if it has none."""
    if name in rig.actuators:
        return rig.actuators[name].display_unit
    if name in rig.channels:
        return rig.channels[name].unit
    return rig.constants[name].unit.text if name in rig.constants else ""


def impossible_notes(result: Survey, rig: Rig) -> Iterator[str]:
    """Return remarks on readings outside the range of their channel."""
    for name, count in result.impossible.items():
        channel = rig.channels[name]
        ends = " to ".join(show(end, channel.unit, difference=channel.difference) for end in channel.band)
        if count == 1:
            yield f"1 reading of {name} lies outside its range, {ends}: it is no value"
        else:
            yield f"{count} readings of {name} lie outside its range, {ends}: they are no values"


def _channel_notes(name: str, span: Span, rows: int, layout: Layout) -> Iterator[str]:
    if not span.values:
        yield f"{name}: no value at all"
        return
    missing = rows - span.values
    if missing:
        share = 100.0 * missing / rows
        yield f"{name}: {missing} of {rows} values are missing ({share:.2g} %); they stay missing"
    if span.values >= _MANY and span.low == span.high:
        value = show(span.low, layout.unit(name), difference=name in layout.differences)
        yield f"{name}: the same value, {value}, in all {span.values} samples; is the sensor connected?"


def _mark_notes(name: str, span: Span, layout: Layout) -> Iterator[str]:
    for si in (span.low, span.high):
        unit = parse_unit(layout.unit(name))
        shown = unit.from_si(si, difference=name in layout.differences)
        mark = next((mark for mark in MARKS if abs(shown - mark) <= 1e-6 * abs(mark)), None)
        if mark is not None and span.low != span.high:
            yield f"{name}: there is {mark:g}; if that marks a missing value, say so: --missing={mark:g}"
