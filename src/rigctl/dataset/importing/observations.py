"""A table without time: each row is an observation at its own condition.

In: a source without a time column. Out: a run without samples, in which each row is a record.
Temperatures, pressures and commands are its condition, everything else is what was observed. Such a table
may also be a log whose time column was not recognised: a quantity in seconds that rises from row to row
is refused, and the user asked.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from rigctl.dataset.importing.cells.labels import read_label
from rigctl.dataset.importing.cells.sentinels import Sentinels, blanked, remark
from rigctl.dataset.importing.checks import InvalidRows, impossible, marks_of, to_si, without_marks
from rigctl.dataset.importing.columns import Assigned, places_of
from rigctl.dataset.importing.first_pass import Survey
from rigctl.dataset.importing.formats.table import KEPT_FAULTS, RowBlock, Source, cut
from rigctl.errors import Location, RigctlError
from rigctl.plan.measured import MeasuredValue
from rigctl.rig.layout import Layout
from rigctl.units import parse_unit

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from rigctl.dataset.recording.writer import RunWriter

#: temperatures and pressures are conditions of an observation
_CONDITIONS: Final = ("K", "Pa")
#: rows from which an increase is no coincidence
_FEWEST: Final = 5
#: share of increases among many changes from row to row; a clock may have been set back, or started again
_RISING: Final = 0.8
#: changes from which a share of them says anything; of fewer, all have to be increases
_MANY: Final = 10


@dataclass(frozen=True)
class Observations:
    """Rows ready to be written: each is a record without samples."""

    source: Source
    assigned: Sequence[Assigned]
    parts: Sequence[RowBlock]
    found: Survey
    remarks: tuple[str, ...] = ()  #: on marks of missing values

    @property
    def layout(self) -> Layout:
        """The layout, without samples."""
        return Layout((), (), ("s", "1"))

    @property
    def rows(self) -> int:
        """Number of observations."""
        return self.found.rows

    def write(self, writer: RunWriter, name: str | None, stem: str) -> int:
        """Write all observations; return their number.

        Commands, temperatures and pressures become the record's sweep, everything else its measures. Missing
        values are omitted.
        """
        for part in self.parts:
            for row in range(len(part.lines)):
                self._write_row(writer, part, row, name, stem)
        return self.rows

    def _write_row(self, writer: RunWriter, part: RowBlock, row: int, name: str | None, stem: str) -> None:
        sweep: dict[str, tuple[float, str]] = {}
        measures: list[tuple[Assigned, float]] = []
        for column in self.assigned:
            written = float(part.columns[column.index][row]) if column.unit is not None else float("nan")
            if column.unit is None or np.isnan(written):
                continue
            value = column.unit.to_si(written, difference=column.difference)
            if impossible(column, np.array([value])).any():
                continue
            if _is_condition(column):
                sweep[column.name] = (value, column.shown)
            else:
                measures.append((column, value))
        label = read_label(part.labels.texts[int(part.labels.codes[row])]) if part.labels else None
        called = name or (label if isinstance(label, str) else stem)
        where = f"line {part.lines[row]}" + (f" of {part.group}" if part.group else "")
        writer.open_record(0.0, called, sweep, where, 0.0)
        for column, value in measures:
            writer.measure(MeasuredValue(column.name, value, column.shown, difference=column.difference))
        writer.close_record(0.0, "complete")


def take_observations(
    source: Source, assigned: Sequence[Assigned], missing: Sequence[float] = (), *, keep_marks: bool = False
) -> Observations:
    """Turn a table without ``time`` into observations; `missing` are numbers that mark missing values.

    Parameters
    ----------
    keep_marks: numbers such as -9999 are readings.

    Raises
    ------
    RigctlError
        a column may be the time of the rows.
    """
    marks = marks_of(missing)
    result = Survey()
    sentinels = Sentinels([column.index for column in assigned if column.unit is not None])
    parts = []
    for part in source.parts(*places_of(assigned)):
        bad = InvalidRows(part)
        for values in part.columns.values():
            bad.add(np.flatnonzero(np.isinf(values)), "not a finite number")
        columns = {index: without_marks(column, marks) for index, column in part.columns.items()}
        parts.append(cut(replace(part, columns=columns, faults=(), more_faults=0), bad.others))
        sentinels.take(parts[-1])
        result.faults += [*part.faults, *bad.faults()]
        result.bad_rows += len(part.faults) + part.more_faults + bad.count
    found = sentinels.found() if keep_marks is False else {}
    parts = [_of_possible_commands(blanked(part, found), assigned, result) for part in parts]
    result.rows = sum(len(part.lines) for part in parts)
    for column in assigned:
        _refuse_a_time(source, column, [part.columns[column.index] for part in parts if column.unit])
    result.impossible = _impossible(assigned, parts)
    result.faults.sort(key=lambda fault: (str(fault.path or ""), fault.line))
    del result.faults[KEPT_FAULTS:]
    remarks = tuple(remark(column.name, found[column.index]) for column in assigned if column.index in found)
    return Observations(source, assigned, parts, result, remarks)


def _of_possible_commands(part: RowBlock, assigned: Sequence[Assigned], result: Survey) -> RowBlock:
    """Return the rows whose commands their actuators can have taken; the others become faults."""
    bad = InvalidRows(part)
    for column in assigned:
        if column.kind == "command":
            bad.add_beyond_limits(column, to_si(column, part.columns[column.index]))
    result.faults += bad.faults()
    result.bad_rows += bad.count
    return cut(part, bad.others)


def _impossible(assigned: Sequence[Assigned], parts: Sequence[RowBlock]) -> dict[str, int]:
    """Return the number of values outside the possible range, by channel; those without any are left out."""
    counts: Counter[str] = Counter()
    for column in assigned:
        if column.possible is not None and column.kind != "command":
            values = [to_si(column, part.columns[column.index]) for part in parts]
            counts[column.name] += sum(int(impossible(column, one).sum()) for one in values)
    return {name: count for name, count in counts.items() if count}


def _refuse_a_time(source: Source, column: Assigned, values: Sequence[NDArray[np.float64]]) -> None:
    """Refuse a quantity in seconds that mostly increases from row to row: its table may be one of samples."""
    if column.unit is None or column.unit.dimension != parse_unit("s").dimension or column.kind != "other":
        return
    heading = source.headings[column.index]
    every = np.concatenate(values) if values else np.zeros(0)
    every = every[np.isfinite(every)]
    changes = np.diff(every)
    changes = changes[changes != 0.0]
    share = _RISING if len(changes) >= _MANY else 1.0
    if len(changes) < _FEWEST - 1 or np.mean(changes > 0.0) < share or heading.name != column.heading.name:
        return
    name, unit = heading.name, column.unit.text
    often = "increases" if (changes > 0.0).all() else "mostly increases"
    raise RigctlError(
        f"{name}: it {often} from row to row; is it the time of the rows, or a duration that was observed?",
        value=f"{every[0]:g} {unit} to {every[-1]:g} {unit}",
        hint=f"Say which: --columns '{name}=time [{unit}]', or '{name}=duration [{unit}]'",
        where=heading.where.or_else(Location(source.path)),
    )


def _is_condition(column: Assigned) -> bool:
    dimension = parse_unit(column.shown).dimension
    return column.kind == "command" or any(dimension == parse_unit(unit).dimension for unit in _CONDITIONS)
