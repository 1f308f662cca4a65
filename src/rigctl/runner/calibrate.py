"""Takes the points of a calibration: the operator types the reference value, the bench is read.

In: an open operator and a channel. Out: points, each a reference value and the raw readings taken at it,
for `rigctl.rig.calibration_fit`. Raw values are recovered from the calibrated ones by the calibration in
force, so that every backend can be calibrated without a second way of reading it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, field

from rigctl.dataset import Run
from rigctl.errors import RigctlError, unknown_name
from rigctl.plan.behaviour import Question
from rigctl.rig import Channel, Rig, parse_rig
from rigctl.rig.calibration_fit import Point
from rigctl.runner.bench_access import Access
from rigctl.runner.manual import Reading, watch
from rigctl.runner.operators.operator import Operator, read_answer
from rigctl.units import significant

#: typed instead of a value, to discard the last point
UNDO = "undo"
_AT_END = 0.5  # steps of the converter from its end


@dataclass
class _Series:
    """The points so far, and the one being taken."""

    name: str
    channel: Channel
    readings: int
    report: Callable[[str], None]
    points: list[Point] = field(default_factory=list)
    reference: float | None = None
    raw: list[float] = field(default_factory=list)
    ended: bool = False

    @property
    def question(self) -> Question:
        """The next question to the operator."""
        last = f", '{UNDO}' takes point {len(self.points)} back" if self.points else ""
        return Question(
            f"Point {len(self.points) + 1}: {self.name} at the reference in {self.channel.unit}"
            f" (nothing ends the series{last})"
        )

    def answer(self, text: str) -> None:
        """Handle what the operator typed."""
        written = text.strip()
        if not written:
            self.ended = True
        elif written.casefold() == UNDO and self.points:
            gone = self.points.pop()
            self.report(f"point at {gone.reference:g} {self.channel.unit} taken back")
        else:
            channel = self.channel
            try:
                answer = read_answer(Question("", name="reference", unit=channel.unit), written)
            except RigctlError as error:
                self.report(str(error))
                return
            self.reference = channel.display.from_si(answer.value or 0.0, difference=channel.difference)

    def take(self, value: float) -> None:
        """Take one SI reading of the point."""
        channel = self.channel
        if math.isnan(value):
            return
        self.raw.append(channel.raw_from_value(value))
        if len(self.raw) < self.readings or self.reference is None:
            return
        point = Point(self.reference, tuple(self.raw))
        self.points.append(point)
        self.raw, self.reference = [], None
        self.report(self._point_text(point))

    def _point_text(self, point: Point) -> str:
        raw, unit = self.channel.raw, self.channel.raw_unit
        text = f"point {len(self.points)}: {point.reference:g} {self.channel.unit} at {point.mean:.6g} {unit}"
        if point.scatter is not None:
            text += f" ± {significant(point.scatter, 2)} ({len(point.raw)} readings)"
        if raw is not None and min(point.mean - raw.low, raw.high - point.mean) < _AT_END * raw.step:
            text += "; the converter is at its end, this point is worth nothing"
        return text


def take_points(
    rig: Rig,
    name: str,
    how: Access,
    operator: Operator,
    *,
    readings: int,
    rate: float,
    report: Callable[[str], None],
) -> list[Point]:
    """Ask for reference values until the operator ends the series, and take `readings` samples at each.

    The bench is read all the time, with its interlocks active and outputs safe.

    Parameters
    ----------
    readings: how many samples make a point.
    rate: of the samples, Hz.
    report: shows what was read.

    Raises
    ------
    RigctlError
        the bench cannot be reached, or has gone silent.
    """
    series = _Series(name, rig.channels[name], readings, report)
    column = rig.layout.channels.index(name)
    question = series.question
    with closing(watch(rig, how, rate)) as samples:
        # The bench is read whether or not a point is being taken: the operator sees alarms, and silence ends
        # the series.
        for reading in samples:
            _sound(reading, report)
            # Samples count only from the answer on; the operator has waited until the reference was steady.
            if series.reference is not None:
                series.take(reading.sample.read.values[column])
                question = series.question
                continue
            try:
                answer = operator.ask(question)
            except RigctlError:  # no further input is possible
                return series.points
            if answer is not None:
                series.answer(answer.text)
                question = series.question
            if series.ended:
                return series.points
    return series.points


def points_of_run(run: Run, rig: Rig, name: str, against: str) -> list[Point]:
    """The points of a run whose records hold a reference value each, as an answer or a measure.

    Raw values come from the samples by the calibration that the run was measured with.

    Parameters
    ----------
    against: the name of that value.

    Raises
    ------
    RigctlError
        no record holds such a value, the run has no such channel, or the converter has changed.
    """
    if not run.header.rig.text:
        raise RigctlError("this run has no rig file with it, so its raw values are not known", value=run.id)
    before, now = parse_rig(run.header.rig.text).channels, rig.channels[name]
    if name not in before:
        raise unknown_name("channel of the run", name, before)
    # The converter must be the same, as raw values are what is calibrated; the calibration may have changed.
    then = before[name]
    if then.raw != now.raw:
        raise RigctlError(f"the converter of '{name}' is another one than in this run", value=run.id)
    points, known = list[Point](), set[str]()
    for index in run.usable:
        record = run.record(index)
        values = {**record.sweep, **record.measures}
        known.update(values)
        raw = tuple(then.raw_from_value(float(v)) for v in record.channels[name] if math.isfinite(v))
        if against in values and raw:
            points.append(Point(now.display.from_si(values[against], difference=now.difference), raw))
    if not points:
        raise unknown_name("value of a record", against, known)
    return points


def _sound(reading: Reading, report: Callable[[str], None]) -> None:
    for alarm in reading.alarms:
        if alarm.active:
            report(alarm.message)
