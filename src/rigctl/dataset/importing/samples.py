"""Writes samples as a run, divided into records, with the switch times of commands.

In: a source, its assigned columns, the options. Out: `Samples`, what the first pass has found, which
`write` then turns into a run. The rows of a short file are kept from the first pass; a long one is read
again. Commands in a log are samples: each change becomes a switch at a time between two rows, with half
their distance as uncertainty.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from rigctl.dataset.importing.campaign import Campaign
from rigctl.dataset.importing.cells.labels import describe_label
from rigctl.dataset.importing.checks import Checked, Checker, Stretch
from rigctl.dataset.importing.columns import Assigned, layout_of
from rigctl.dataset.importing.conditions import conditions_of
from rigctl.dataset.importing.first_pass import RecordFacts, Survey, survey
from rigctl.dataset.importing.formats.table import Source
from rigctl.dataset.importing.options import Options
from rigctl.dataset.importing.stages import Stages
from rigctl.errors import Location, RigctlError
from rigctl.rig.layout import Layout

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from rigctl.dataset.recording.writer import RunWriter
    from rigctl.rig import Rig

#: size limit of a short file, bytes of samples: a million rows of a dozen columns
_SHORT: Final = 100_000_000
#: a file with as few rows may have a record for each
_FEWEST: Final = 3


@dataclass(frozen=True)
class Samples:
    """A file of samples after the first pass, ready to be written.

    A long file is read again rather than kept in memory, so that its length does not matter; `kept` is the
    content of a short one, and empty for a long one.
    """

    source: Source
    assigned: Sequence[Assigned]
    layout: Layout
    found: Survey
    options: Options
    stages: Stages
    kept: Sequence[Checked] = ()

    @property
    def rows(self) -> int:
        """Number of valid samples."""
        return self.found.rows

    def write(self, writer: RunWriter, name: str | None, stem: str) -> int:
        """Write all samples; return the number of records.

        Parameters
        ----------
        name: of every record; by default its name in the file, or `stem` if that is a number.
        """
        recorder = _Recorder(writer, self.layout, self.found.records, name, stem)
        for part in self.kept or checked(self.source, self.stages, self.checker()):
            for stretch in part.stretches:
                recorder.take(part.block[stretch.start : stretch.stop], stretch)
        recorder.close()
        return len(self.found.records)

    def checker(self) -> Checker:
        """Return a new checker of the rows."""
        return _checker(self.assigned, self.layout, self.options)


def _checker(assigned: Sequence[Assigned], layout: Layout, options: Options) -> Checker:
    return Checker(assigned, layout, options.missing_numbers)


def take_samples(
    source: Source,
    assigned: Sequence[Assigned],
    rig: Rig,
    options: Options,
    *,
    keep_good: bool,
    on_progress: Callable[[str], None] = lambda _: None,
) -> Samples:
    """Make the first pass over a file of samples; invalid rows are listed as faults.

    Raises
    ------
    RigctlError
        the file cannot be read.
    """
    layout = layout_of(assigned, rig)
    kept: list[Checked] = []
    stages = Stages(options, assigned, on_progress)

    def survey_all() -> Survey:
        kept.clear()
        checker = _checker(assigned, layout, options)
        parts = _keeping(checked(source, stages, checker), kept)
        return survey(parts, checker, layout, conditions_of(layout, rig), keep_good=keep_good)

    result = survey_all()
    if stages.find_marks():  # among all values of a column it is known which of them are none
        result = survey_all()
    _refuse_row_numbers(source, assigned, result)
    if isinstance(source, Campaign) and not keep_good:
        _refuse_copies(source, result)
    return Samples(source, assigned, layout, result, options, stages, kept)


def copies_in(found: Survey) -> list[tuple[str, str]]:
    """Return the records that have the same samples as one before them, and that one, as described."""
    first: dict[bytes, str] = {}
    copies = []
    for record in found.records:
        label = describe_label(record.label)
        original = first.setdefault(record.digest, label)
        if record.digest and original != label:
            copies.append((label, original))
    return copies


def _refuse_copies(source: Source, found: Survey) -> None:
    """Refuse a file with the samples of another, which would count twice, and be held out of its own fit.

    Within one file such records get a remark: without noise, as in a simulation, repetitions are the same.
    """
    for copy, original in copies_in(found):
        raise RigctlError(
            f"{copy} has the same samples as {original}",
            expected="each measurement once",
            hint="Leave one of them out, for instance one of two files; '--keep-good' imports both, with a "
            "remark, and an analysis counts them once",
            where=Location(source.path),
        )


def _refuse_row_numbers(source: Source, assigned: Sequence[Assigned], found: Survey) -> None:
    """Refuse a record for every row: the column counts the rows, as loggers do."""
    column = next((column for column in assigned if column.kind == "record"), None)
    if column is None or not _FEWEST < found.rows == len(found.records):
        return
    name = source.headings[column.index].name
    raise RigctlError(
        f"{name}: every row has a record of its own; does it count the rows?",
        value=f"{len(found.records)} records in {found.rows} rows",
        expected="one number or name for all rows of a record",
        hint=f"Leave it out: --columns '{name}=-'",
        where=column.heading.where.or_else(Location(source.path)),
    )


def checked(source: Source, stages: Stages, checker: Checker) -> Iterator[Checked]:
    """Yield the parts of a file, in SI and without bad rows."""
    for part in stages.parts(source):
        yield checker.take(part)


def _keeping(parts: Iterator[Checked], kept: list[Checked]) -> Iterator[Checked]:
    """Yield the parts, and store all of them in `kept` if the file is short."""
    size = 0
    for part in parts:
        size += part.block.nbytes
        if size <= _SHORT:
            kept.append(part)
        else:
            kept.clear()
        yield part


class _Recorder:
    """Writes one stretch after the other, and keeps track of the open record and its commands."""

    def __init__(
        self,
        writer: RunWriter,
        layout: Layout,
        records: Sequence[RecordFacts],
        name: str | None,
        stem: str,
    ) -> None:
        self._writer = writer
        self._layout = layout
        self._records = records
        self._name = name
        self._stem = stem
        self._index = -1
        self._last_time = 0.0
        self._told: dict[str, tuple[float, float]] = {}  # time and value of each command's last sample

    def take(self, rows: NDArray[np.float64], stretch: Stretch) -> None:
        if stretch.begins:
            self.close()
            if stretch.record >= 0:
                self._open(float(rows[0, 0]), self._records[stretch.record])
        rows[:, 1] = self._index
        self._writer.append_block(rows)
        self._log_switches(rows)
        self._last_time = float(rows[-1, 0])

    def close(self) -> None:
        """End the open record, if there is one."""
        if self._index >= 0:
            self._writer.close_record(self._last_time, "complete")
        self._index = -1
        self._told = {}

    def _open(self, time: float, facts: RecordFacts) -> None:
        label = facts.label if isinstance(facts.label, str) else self._stem
        sweep = {
            name: (value, self._layout.unit(name))
            for name, value in facts.values.items()
            if not np.isnan(value)
        }
        path = describe_label(facts.label)
        self._index = self._writer.open_record(time, self._name or label, sweep, path, facts.rate)
        if facts.gap is not None:
            gap = facts.gap
            more = f", the longest of {gap.count} gaps" if gap.count > 1 else ""
            self._writer.event(
                gap.start, "gap", message=f"no samples for {gap.length:.4g} s from {gap.start:.6g} s on{more}"
            )

    def _log_switches(self, rows: NDArray[np.float64]) -> None:
        """Log a switch for each command that differs between two samples, at a time between them."""
        switches = []
        for index, actuator in enumerate(self._layout.commands, start=2 + len(self._layout.channels)):
            known = np.flatnonzero(~np.isnan(rows[:, index]))
            if not len(known):
                continue
            values, times = rows[known, index], rows[known, 0]
            # A switch may lie between two stretches: the last sample of the one before is compared too.
            if actuator in self._told:
                time, value = self._told[actuator]
                times, values = np.concatenate([[time], times]), np.concatenate([[value], values])
            self._told[actuator] = (float(times[-1]), float(values[-1]))
            for after in (np.flatnonzero(np.diff(values)) + 1).tolist():
                half = 0.5 * float(times[after] - times[after - 1])
                switches.append((float(times[after]) - half, actuator, float(values[after]), half))
        for time, actuator, value, half in sorted(switches):
            self._writer.event(time, "command", actuator=actuator, value=value, uncertainty=half)
