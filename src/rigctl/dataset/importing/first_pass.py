"""The first pass over a file: facts about every record, before any is written.

In: the checked rows, part by part. Out: a `Survey`: the records with their rates, gaps and conditions,
the bad rows, the range of every column, sensors that stand still. A record's condition (its temperature,
say) is known only at its end and stored at its beginning, which is why a pass comes before the writing.
Memory is
needed only for the times and the columns on which conditions depend.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from rigctl.dataset.conditions import cluster
from rigctl.dataset.gaps import Gap, find_gap
from rigctl.dataset.importing.cells.labels import Label
from rigctl.dataset.importing.checks import Checked, Checker, Stretch
from rigctl.dataset.importing.conditions import Conditions
from rigctl.dataset.importing.formats.table import KEPT_FAULTS, Fault
from rigctl.dataset.standstill import Standstill, StandstillDetector

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from rigctl.rig.layout import Layout

#: a file with more bad rows than this is not read further
MOST_BAD: Final = 100_000
#: samples for the value at a record's start, since one of them may be a spike
_FIRST: Final = 5
#: samples of records that are alike to the last bit by more than chance
_ALIKE: Final = 20


@dataclass(frozen=True)
class RecordFacts:
    """One record of the file: its rate in Hz (0 for a single sample), the SI values of its condition.

    `digest` is the same for records with the same samples, from their beginning on; empty if no channel
    changes or there are too few of them to recognise a copy.
    """

    label: Label
    rate: float
    gap: Gap | None
    values: Mapping[str, float]
    digest: bytes = b""


@dataclass
class Span:
    """The number of values of one channel, and the smallest and the largest, SI."""

    values: int = 0
    low: float = np.inf
    high: float = -np.inf

    def add(self, values: NDArray[np.float64]) -> None:
        """Add some values, NaN where one is missing."""
        present = values[~np.isnan(values)]
        self.values += len(present)
        if len(present):
            self.low = min(self.low, float(present.min()))
            self.high = max(self.high, float(present.max()))


@dataclass
class Survey:
    """The result of the first pass over a file of samples.

    Parameters
    ----------
    records: in the order of the file; equal conditions have identical values.
    rows: number of valid rows.
    faults: of the first bad rows; `bad_rows` is the number of all.
    spans: by channel or command.
    impossible: by channel, the number of readings outside the possible range, which are no values.
    standstills: by channel, the stretches in which it repeats one value although it has noise.
    """

    records: list[RecordFacts] = field(default_factory=list)
    rows: int = 0
    faults: list[Fault] = field(default_factory=list)
    bad_rows: int = 0
    spans: dict[str, Span] = field(default_factory=dict)
    impossible: Mapping[str, int] = field(default_factory=dict)
    standstills: Mapping[str, Sequence[Standstill]] = field(default_factory=dict)


def survey(
    parts: Iterable[Checked],
    checker: Checker,
    layout: Layout,
    conditions: Conditions,
    *,
    keep_good: bool = True,
) -> Survey:
    """Read through a file; without `keep_good`, only until too many rows are bad."""
    result = Survey(spans={name: Span() for name in (*layout.channels, *layout.commands)})
    detectors = {name: StandstillDetector() for name in layout.channels}
    open_record: _Gathered | None = None
    for part in parts:
        result.rows += len(part.block)
        result.bad_rows += part.bad_rows
        result.faults += part.faults[: KEPT_FAULTS - len(result.faults)]
        if result.bad_rows > MOST_BAD and not keep_good:
            break
        for name, span in result.spans.items():
            span.add(part.block[:, layout.columns.index(name)])
        for stretch in part.stretches:
            if stretch.begins and open_record is not None:
                open_record.end(result, checker)
                open_record = None
            if stretch.record >= 0:
                open_record = open_record or _Gathered(stretch.record, layout, conditions, detectors)
                open_record.add(part.block, stretch)
    if open_record is not None:
        open_record.end(result, checker)
    result.impossible = checker.impossible
    found = {name: detector.found() for name, detector in detectors.items()}
    result.standstills = {name: stretches for name, stretches in found.items() if stretches}
    result.records = _alike(result.records, conditions)
    return result


class _Gathered:
    """The data collected of a record while its rows are read."""

    def __init__(
        self,
        record: int,
        layout: Layout,
        conditions: Conditions,
        detectors: Mapping[str, StandstillDetector],
    ) -> None:
        self._record = record
        self._layout = layout
        self._conditions = conditions
        self._kept: dict[str, list[NDArray[np.float64]]] = {
            name: [] for name in ("time", *conditions.medians, *conditions.starts, *conditions.levels)
        }
        self._digest = hashlib.sha256()
        self._first: NDArray[np.float64] | None = None
        self._changes = False
        self._detectors = detectors
        for detector in detectors.values():
            detector.begin_record()

    def add(self, block: NDArray[np.float64], stretch: Stretch) -> None:
        rows = np.delete(block[stretch.start : stretch.stop], 1, axis=1)  # without the record's number
        if self._first is None:
            self._first = rows[0].copy()
        # A copy may begin at another time; rounded, as the difference of decimals is not exact.
        rows[:, 0] = np.round(rows[:, 0] - self._first[0], 9)
        measured = slice(1, 1 + len(self._layout.channels))
        self._changes |= bool((np.abs(rows[:, measured] - self._first[measured]) > 0.0).any())
        self._digest.update(np.ascontiguousarray(rows).tobytes())
        for name, pieces in self._kept.items():
            values = block[stretch.start : stretch.stop, self._layout.columns.index(name)]
            if name in self._conditions.starts:
                values = values[~np.isnan(values)][:_FIRST]
            elif name in self._conditions.levels:
                values = np.unique(values[~np.isnan(values)])
            pieces.append(values.copy())
        times = block[stretch.start : stretch.stop, self._layout.columns.index("time")]
        for name, detector in self._detectors.items():
            detector.add(times, block[stretch.start : stretch.stop, self._layout.columns.index(name)])

    def end(self, result: Survey, checker: Checker) -> None:
        """Add the record to the result."""
        result.records.append(self.facts(checker))

    def facts(self, checker: Checker) -> RecordFacts:
        values = {}
        for name in self._conditions.medians:
            values[name] = _median(self._whole(name))
        for name in self._conditions.levels:
            levels = np.unique(self._whole(name))
            values[name] = float(levels[0]) if len(levels) == 1 else float("nan")
        for name in self._conditions.starts:
            values[name] = _median(self._whole(name)[:_FIRST])
        times = self._whole("time")
        steps = np.diff(times)
        label = checker.book.labels[checker.record_ids[self._record]]
        usual = float(np.median(steps)) if len(steps) else 0.0
        known = self._changes and len(times) >= _ALIKE
        digest = self._digest.digest() if known else b""
        return RecordFacts(label, _rate(usual), find_gap(times), values, digest)

    def _whole(self, name: str) -> NDArray[np.float64]:
        """Return a whole column and free its parts: a record can be as long as the file."""
        return np.concatenate(self._kept.pop(name))


def _alike(records: list[RecordFacts], conditions: Conditions) -> list[RecordFacts]:
    """Return the records with equal temperatures for equal conditions."""
    values = [dict(record.values) for record in records]
    for name in conditions.clustered:
        for facts, centre in zip(values, cluster([facts[name] for facts in values]), strict=True):
            facts[name] = centre
    return [replace(record, values=facts) for record, facts in zip(records, values, strict=True)]


def _rate(step: float) -> float:
    """Return the sampling rate; times are decimals, so that their steps are not exact."""
    return float(f"{1.0 / step:.9g}") if step > 0.0 else 0.0


def _median(values: NDArray[np.float64]) -> float:
    present = values[~np.isnan(values)]
    return float(np.median(present)) if len(present) else float("nan")
