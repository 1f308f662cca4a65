"""A run as the page needs it: every number in its display unit, every record with its rows.

In: a `Run`. Out: a `RunData` with all numbers in memory, from which the sections of the page are made;
none of them opens a file. This is the edge at which SI becomes display units.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rigctl.dataset.history import EventEntry
from rigctl.errors import RigctlError
from rigctl.json_values import parse_json
from rigctl.rig import Rig, parse_rig
from rigctl.units import Dimension, parse_unit

if TYPE_CHECKING:
    import pandas as pd

    from rigctl.dataset import Run

COMPLETE = "complete"


@dataclass(frozen=True)
class Signal:
    """A channel or a command over the whole run, in its display unit; shape (rows,)."""

    name: str
    unit: str
    values: NDArray[np.float64]
    command: bool = False

    @property
    def dimension(self) -> Dimension:
        """Dimension of the display unit."""
        return parse_unit(self.unit).dimension


@dataclass(frozen=True)
class Measured:
    """A value kept with a record (or with the run: `record` −1) and its limits, in `unit`."""

    name: str
    value: float
    unit: str
    low: float | None
    high: float | None
    passed: bool
    record: int = -1

    @property
    def limited(self) -> bool:
        """True if it has a limit."""
        return self.low is not None or self.high is not None


@dataclass(frozen=True)
class RecordData:
    """One record: its operating point, its outcome, and its rows in the run."""

    index: int
    name: str
    start: float
    end: float
    outcome: str
    excluded: str | None
    sweep: Mapping[str, tuple[float, str]]  #: value and unit, as shown
    measures: tuple[Measured, ...]
    rows: slice

    @property
    def usable(self) -> bool:
        """True if it was measured as planned and nobody excluded it."""
        return self.outcome == COMPLETE and self.excluded is None


@dataclass(frozen=True)
class RunData:
    """A run with all its numbers in memory; `info` is its ``run.json``."""

    id: str
    info: Mapping[str, Any]
    time: NDArray[np.float64]
    signals: Mapping[str, Signal]
    records: tuple[RecordData, ...]
    events: tuple[EventEntry, ...]
    measures: tuple[Measured, ...]  #: measures of the run itself
    rig: Rig | None

    def all_measures(self) -> Iterator[Measured]:
        """The measures of the run, then those of every record."""
        yield from self.measures
        for record in self.records:
            yield from record.measures


def read_run(run: Run) -> RunData:
    """Read everything that the page shows of a run.

    Raises
    ------
    RigctlError
        a file of the run is missing or damaged.
    """
    layout = run.layout
    frame = run.samples()
    signals = {
        name: Signal(name, layout.unit(name), _column(frame, name), command=name in layout.commands)
        for name in layout.signals
    }
    with run.event_data():
        events = tuple(_events(run.events))
        measures = tuple(_measure(event) for event in events if event.kind == "measure")
        records = tuple(_records(run.records, events, measures, frame["record"].to_numpy()))
    return RunData(
        id=run.id,
        info=run.info,
        time=_column(frame, "time"),
        signals=signals,
        records=records,
        events=events,
        measures=tuple(measured for measured in measures if measured.record < 0),
        rig=_rig(run.info),
    )


def _column(frame: pd.DataFrame, name: str) -> NDArray[np.float64]:
    return np.asarray(frame[name].to_numpy(), dtype=np.float64)


def _events(frame: pd.DataFrame) -> Iterator[EventEntry]:
    names = ("time", "kind", "record", "path", "message", "data")
    columns = [frame[name].tolist() for name in names]
    for time, kind, record, path, message, data in zip(*columns, strict=True):
        facts = parse_json(data) if isinstance(data, str) else {}
        yield EventEntry(float(time), str(kind), int(record), _text(path), _text(message), facts)


def _text(value: object) -> str | None:
    """A cell of text; "" for any of the missing-value markers of pandas."""
    return value if isinstance(value, str) else None


def _measure(event: EventEntry) -> Measured:
    facts = event.data
    unit = parse_unit(str(facts["unit"]))

    def shown(si: float | None) -> float | None:
        return None if si is None else unit.from_si(si, difference=bool(facts.get("difference")))

    value = shown(facts["value"])
    return Measured(
        name=str(facts["name"]),
        value=float("nan") if value is None else value,
        unit=unit.text,
        low=shown(facts.get("low")),
        high=shown(facts.get("high")),
        passed=bool(facts.get("passed", True)),
        record=int(facts.get("record", -1)),
    )


def _records(
    frame: pd.DataFrame,
    events: Sequence[EventEntry],
    measures: Sequence[Measured],
    row_records: NDArray[np.int32],
) -> Iterator[RecordData]:
    rows = rows_of_records(row_records)
    sweeps = {
        int(event.data["record"]): event.data.get("sweep", {})
        for event in events
        if event.kind == "record" and event.data.get("state") == "open"
    }
    by_record: dict[int, list[Measured]] = {}
    for measured in measures:
        by_record.setdefault(measured.record, []).append(measured)
    names = ("record", "name", "start", "end", "outcome", "excluded")
    for index, name, start, end, outcome, excluded in zip(*(frame[n].tolist() for n in names), strict=True):
        swept = sweeps.get(int(index), {})
        yield RecordData(
            index=int(index),
            name=str(name),
            start=float(start),
            end=float(end),
            outcome=str(outcome),
            excluded=_text(excluded),
            sweep={key: _swept(value, unit) for key, (value, unit) in swept.items()},
            measures=tuple(by_record.get(int(index), ())),
            rows=rows.get(int(index), slice(0, 0)),
        )


def _swept(si: float | None, unit: str) -> tuple[float, str]:
    """A sweep value as shown, without rounding errors of the conversion: 30 bar, not 29.999…"""
    value = float("nan") if si is None else parse_unit(unit).from_si(si)
    return (float(f"{value:.12g}"), unit)


def rows_of_records(row_records: NDArray[np.int32]) -> dict[int, slice]:
    """First to last row of every record; `row_records` names each row's record, −1 between records."""
    if not len(row_records):
        return {}
    starts = np.concatenate(([0], np.flatnonzero(np.diff(row_records)) + 1))
    ends = np.concatenate((starts[1:], [len(row_records)]))
    ranges: dict[int, slice] = {}
    for start, end in zip(starts.tolist(), ends.tolist(), strict=True):
        index = int(row_records[start])
        if index >= 0:
            ranges[index] = slice(ranges[index].start if index in ranges else start, end)
    return ranges


def _rig(info: Mapping[str, Any]) -> Rig | None:
    """The rig at the time of the run; None for data without a complete rig file."""
    text = info.get("rig", {}).get("text")
    if not text:
        return None
    try:
        return parse_rig(text)
    except RigctlError:
        return None
