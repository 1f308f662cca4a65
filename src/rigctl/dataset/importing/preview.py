"""Preview of an import, without making a run: columns, records, and a plot of each column.

In: files and options, as for an import. Out: a `Preview`: how each column was understood, which records
it would make, the bad rows, and curves. The rows pass the same stages as in an import, so that what is
shown is what would be stored, and the notes are those that the run would have; nothing is written.

Of each column only minimum and maximum over equal stretches of rows are kept, some hundred points for a
file of any length. A spike of a single row is still visible in them, and a mean would hide it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from rigctl.dataset.importing.bring_in import remarks_of, take
from rigctl.dataset.importing.cells.times import instant
from rigctl.dataset.importing.first_pass import RecordFacts
from rigctl.dataset.importing.formats.formats import stem_of
from rigctl.dataset.importing.formats.table import Fault
from rigctl.dataset.importing.observations import Observations
from rigctl.dataset.importing.options import Options
from rigctl.dataset.importing.samples import Samples, checked
from rigctl.units import parse_unit

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from rigctl.rig import Rig

#: points per curve
_POINTS: Final = 480


@dataclass(frozen=True)
class ColumnPreview:
    """One column that would be read.

    Parameters
    ----------
    theirs, written: its name and its unit in the file.
    ours, kind, unit: our name, its kind (time, channel, command, other), the unit in which it is stored.
    values, missing: their counts.
    low, high: in `unit`; None without values.
    course: (2, points) minimum and maximum over equal stretches of rows, in `unit`, NaN without values.
    """

    theirs: str
    written: str
    ours: str
    kind: str
    unit: str
    values: int
    missing: int
    low: float | None
    high: float | None
    course: NDArray[np.float64]

    @property
    def is_sampled(self) -> bool:
        """Whether it is a curve over time: a channel or a command."""
        return self.kind in ("channel", "command")


@dataclass(frozen=True)
class RecordPreview:
    """One record that would be made: times in s of the run."""

    name: str
    start: float
    end: float
    rows: int


@dataclass(frozen=True)
class Preview:
    """What an import would read.

    Parameters
    ----------
    started: start of the data; None if unknown.
    faults: of the first of the `bad_rows`.
    times: (points) of the curves: the middle of each stretch, s; row numbers if time restarts.
    elapsed: `times` are times, not row numbers.
    """

    columns: tuple[ColumnPreview, ...]
    records: tuple[RecordPreview, ...]
    rows: int
    started: datetime | None
    bad_rows: int
    faults: tuple[Fault, ...]
    notes: tuple[str, ...]
    times: NDArray[np.float64]
    elapsed: bool = True

    def as_data(self) -> dict[str, Any]:
        """Return the preview as plain data, without the curves."""
        names = ("theirs", "written", "ours", "kind", "unit", "values", "missing", "low", "high")
        return {
            "rows": self.rows,
            "records": [vars(record) for record in self.records],
            "columns": [{name: getattr(column, name) for name in names} for column in self.columns],
            "started": None if self.started is None else self.started.isoformat(),
            "bad_rows": self.bad_rows,
            "notes": list(self.notes),
        }


def preview_files(paths: Sequence[Path], rig: Rig | None, options: Options) -> Preview:
    """Read files as an import would, without making a run.

    Raises
    ------
    RigctlError
        a file cannot be read, or a column is unknown.
    """
    taken = take(paths, rig, options, keep_good=True)
    result = taken.found
    remarks = remarks_of(taken, rig, options)
    origin = taken.source.origin
    started = None if origin is None else instant(origin, options.zone)
    columns: tuple[ColumnPreview, ...]
    times: NDArray[np.float64]
    records: tuple[RecordPreview, ...]
    if isinstance(taken, Observations):
        columns, times, records = _observed(taken), np.zeros(0), ()
    else:
        columns, times, records = _sampled(taken)
    elapsed = not np.any(np.diff(times) <= 0.0)
    if not elapsed:  # time restarts with a record
        times = np.asarray(
            (np.arange(len(times)) + 0.5) * max(result.rows / len(times), 1.0), dtype=np.float64
        )
    faults = tuple(result.faults)
    return Preview(columns, records, result.rows, started, result.bad_rows, faults, remarks, times, elapsed)


def _observed(taken: Observations) -> tuple[ColumnPreview, ...]:
    previews = []
    for column in taken.assigned:
        if column.unit is None:
            continue
        written = [part.columns[column.index] for part in taken.parts]
        values = np.concatenate(written) if written else np.zeros(0)
        si = values * column.unit.factor + (0.0 if column.difference else column.unit.offset)
        shown = _shown(si, column.shown, difference=column.difference)
        previews.append(
            _column(column.heading.name, column.heading.unit, column.name, column.kind, column.shown, shown)
        )
    return tuple(previews)


def _sampled(
    taken: Samples,
) -> tuple[tuple[ColumnPreview, ...], NDArray[np.float64], tuple[RecordPreview, ...]]:
    """Return the columns, the times of their curves and the records, reading the file as an import would."""
    width = max(-(-taken.rows // _POINTS), 1)
    points = -(-taken.rows // width)
    order = list(taken.layout.columns)
    lows, highs = np.full((points, len(order)), np.nan), np.full((points, len(order)), np.nan)
    counts, row = np.zeros(len(order), dtype=np.int64), 0
    spans: dict[int, list[float]] = {}
    headings = taken.source.headings
    for part in taken.kept or checked(taken.source, taken.stages, taken.checker()):
        bins = (row + np.arange(len(part.block))) // width
        for index in np.unique(bins).tolist():
            block = part.block[bins == index]
            lows[index] = np.fmin(lows[index], np.fmin.reduce(block, axis=0))
            highs[index] = np.fmax(highs[index], np.fmax.reduce(block, axis=0))
        counts += (~np.isnan(part.block)).sum(axis=0)
        row += len(part.block)
        for stretch in part.stretches:
            if stretch.record >= 0:
                times = part.block[stretch.start : stretch.stop, 0]
                span = spans.setdefault(stretch.record, [float(times[0]), float(times[-1]), 0.0])
                span[1], span[2] = float(times[-1]), span[2] + len(times)
    previews = []
    for column in taken.assigned:
        if column.kind in ("record", "clock"):
            continue
        index = order.index(column.name)
        course = np.vstack([lows[:, index], highs[:, index]])
        shown = _shown(course, column.shown, difference=column.difference)
        heading = headings[column.index]
        entry = _column(heading.name, heading.unit, column.name, column.kind, column.shown, shown)
        count = int(counts[index])
        previews.append(ColumnPreview(**{**vars(entry), "values": count, "missing": taken.rows - count}))
    middle = 0.5 * (lows[:, 0] + highs[:, 0])
    stem = stem_of(taken.source.path)
    records = tuple(
        RecordPreview(_name(facts, stem), span[0], span[1], int(span[2]))
        for facts, span in zip(taken.found.records, [spans[key] for key in sorted(spans)], strict=True)
    )
    return tuple(previews), middle, records


def _name(facts: RecordFacts, stem: str) -> str:
    """Return the name that the record would have."""
    return facts.label if isinstance(facts.label, str) else stem


def _shown(si: NDArray[np.float64], unit: str, *, difference: bool) -> NDArray[np.float64]:
    parsed = parse_unit(unit)
    return (si - (0.0 if difference else parsed.offset)) / parsed.factor


def _column(
    theirs: str, written: str | None, ours: str, kind: str, unit: str, values: NDArray[np.float64]
) -> ColumnPreview:
    """Make a column's preview, with a curve if there are at least two rows."""
    present = values[~np.isnan(values)]
    low, high = (float(present.min()), float(present.max())) if len(present) else (None, None)
    course = values if values.ndim == 2 else np.vstack([values, values])
    return ColumnPreview(
        theirs, written or "", ours, kind, unit, len(present), len(values) - len(present), low, high, course
    )
