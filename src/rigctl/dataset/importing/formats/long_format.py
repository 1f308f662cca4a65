"""Files in long format: a time, the name of a channel, and its value in each row."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from rigctl.dataset.importing.cells.headings import split_heading
from rigctl.dataset.importing.cells.increasing import order_of, repeated
from rigctl.dataset.importing.formats.table import GOES_BACK, KEPT_FAULTS, Fault, Heading, RowBlock, Source
from rigctl.dataset.importing.options import Options
from rigctl.errors import Location, RigctlError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@dataclass(frozen=True)
class LongFile:
    """A file in long format as a table with a column for each channel, held in memory.

    Parameters
    ----------
    times: (n) of the rows, without repeats, in the order of the file.
    values: by the name of the channel, (n) each, NaN where it was not sampled.
    """

    path: Path
    headings: tuple[Heading, ...]
    origin: int | None
    times: NDArray[np.float64]
    values: tuple[NDArray[np.float64], ...]
    lines: NDArray[np.int64]
    faults: tuple[Fault, ...] = ()
    more_faults: int = 0
    remarks: tuple[str, ...] = field(default=())

    def parts(self, wanted: Collection[int], record: int | None) -> Iterator[RowBlock]:
        """Yield all rows at once."""
        columns = {index: self.times if index == 0 else self.values[index - 1] for index in wanted}
        yield RowBlock(columns, self.lines, None, self.faults, more_faults=self.more_faults)


def is_long(source: Source, options: Options) -> bool:
    """Return whether the options map one column to channel names, and another to their values."""
    ours = {options.ours(heading.name) for heading in source.headings}
    return {"channel", "value"} <= ours


def open_long(source: Source, options: Options) -> LongFile:
    """Return the file as a table with a column for each channel.

    Raises
    ------
    RigctlError
        it has no time, or distinguishes records.
    """
    import numpy as np

    ours = [options.ours(heading.name) for heading in source.headings]
    if "time" not in ours or "record" in ours:
        raise RigctlError(
            "a file with one value in each row",
            value=", ".join(heading.name for heading in source.headings),
            expected="columns mapped to time, channel and value, and none to record (--split)",
            where=Location(source.path),
        )
    time, value, channel = (ours.index(name) for name in ("time", "value", "channel"))
    names: dict[str, int] = {}
    times, values, codes, lines = [], [], [], []
    faults: list[Fault] = []
    more = 0
    for part in source.parts([time, value], channel):
        labels = part.labels
        if labels is None:
            continue
        known = [names.setdefault(text.strip(), len(names)) for text in labels.texts]
        codes.append(np.array(known, dtype=np.int64)[labels.codes])
        times.append(part.columns[time])
        values.append(part.columns[value])
        lines.append(part.lines)
        faults += part.faults
        more += part.more_faults
    names.pop("", None)
    every = np.concatenate(times) if times else np.zeros(0)
    which = np.concatenate(codes) if codes else np.zeros(0, dtype=np.int64)
    all_values = np.concatenate(values) if values else np.zeros(0)
    where = np.concatenate(lines) if lines else np.zeros(0, dtype=np.int64)
    remarks = list(source.remarks)
    rising = []
    for name, code in names.items():
        rows_of_channel = np.flatnonzero((which == code) & ~np.isnan(all_values) & ~np.isnan(every))
        order = order_of(every[rows_of_channel], options.time_policy)
        every[rows_of_channel] = order.times
        rising.append(rows_of_channel[order.rising])
        back, again = (
            rows_of_channel[order.back].tolist(),
            rows_of_channel[~order.rising & ~order.back].tolist(),
        )
        if again:
            remarks.append(repeated(name, len(again), line=int(where[again[0]])))
        if back and options.time_policy == "drop":
            remarks.append(f"{name}: {len(back)} values whose time goes back were dropped")
        elif back:
            faults += [Fault(int(where[row]), GOES_BACK, name) for row in back[:KEPT_FAULTS]]
            more += max(len(back) - KEPT_FAULTS, 0)
    moments, first, inverse = np.unique(every, return_index=True, return_inverse=True)
    table = []
    for rows in rising:
        column = np.full(len(moments), np.nan)
        column[inverse[rows]] = all_values[rows]
        table.append(column)
    faults.sort(key=lambda fault: fault.line)
    heading = source.headings[time]
    unit = options.unit_of(source.headings[value].name) or source.headings[value].unit
    headings = [heading]
    for name in names:
        plain, own_unit = split_heading(name)
        headings.append(Heading(plain or name, own_unit or unit, Location(source.path)))
    return LongFile(
        source.path,
        tuple(headings),
        source.origin,
        moments,
        tuple(table),
        where[first],
        tuple(faults),
        more,
        tuple(remarks),
    )
