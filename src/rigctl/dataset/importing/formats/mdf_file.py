"""ASAM MDF 4 (and 3): each channel group is a record; time is its master, units are the channels' own.

In: a file, read by asammdf in a process of its own. Out: its channel groups as `Group`s. A small file is
held in memory; a large one is read in pieces, and again on each pass.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rigctl.dataset.importing.cells.headings import split_heading, unit_of
from rigctl.dataset.importing.cells.local_time import LocalTime
from rigctl.dataset.importing.formats.groups import (
    LARGE,
    Column,
    Group,
    GroupedFile,
    clear_errors,
    held,
    missing_extra,
    open_groups,
    overheard,
)
from rigctl.dataset.importing.options import Options
from rigctl.files.regular import regular

if TYPE_CHECKING:
    from numpy.typing import NDArray


def open_mdf(path: Path, options: Options) -> GroupedFile:
    """Read an MDF file.

    Raises
    ------
    RigctlError
        asammdf is not installed, the file cannot be read, or its channel groups are not records.
    """
    try:
        from asammdf import MDF
    except ImportError as problem:
        raise missing_extra("mdf", "asammdf", path) from problem

    messages: list[str] = []
    origins: list[int | None] = []
    remarks: list[str] = []

    @contextmanager
    def reading() -> Iterator[Sequence[Group]]:
        # opened here, since the library creates a missing file and leaves damaged ones open
        with (
            clear_errors(path, "MDF"),
            overheard("asammdf", messages),
            open(path, "rb", opener=regular) as raw,
            MDF(raw) as file,
        ):
            origins.append(_started(file, options, remarks))
            yield _groups(file, remarks)

    with clear_errors(path, "MDF"):
        small = path.stat().st_size <= LARGE
    if small:
        with reading() as groups:
            in_memory = [held(group) for group in groups]
        grouped = open_groups(path, lambda: nullcontext(in_memory), options, "channel group", messages)
    else:
        grouped = open_groups(path, reading, options, "channel group", messages)
    return replace(grouped, began=origins[0], remarks=(*grouped.remarks, *dict.fromkeys(remarks)))


def _groups(file: Any, remarks: list[str]) -> list[Group]:
    result: list[Group] = []
    for index, group in enumerate(file.groups):
        rows = int(group.channel_group.cycles_nr)
        if not rows:
            continue
        master = file.masters_db.get(index)
        columns = [
            _column(file, index, channel) for channel in range(len(group.channels)) if channel != master
        ]
        name = _name(group, index, {other.name for other in result})
        if master is not None:
            others = [column for column in columns if column.name != "time"]
            if len(others) < len(columns):
                remarks.append(
                    f"channel group '{name}': the channel 'time' is left out, its master channel is the time"
                )
            columns = [Column("time", "s", _master(file, index)), *others]
        result.append(Group(name, rows, tuple(columns)))
    return result


def _name(group: Any, index: int, taken: set[str]) -> str:
    """Return a unique name of a channel group from the file."""
    channel_group = group.channel_group
    name = str(getattr(channel_group, "acq_name", "") or getattr(channel_group, "comment", "") or "").strip()
    name = name or f"{index + 1}"
    return f"{name} ({index + 1})" if name in taken else name


def _column(file: Any, group: int, channel: int) -> Column:
    first = file.get(group=group, index=channel, record_count=1, ignore_invalidation_bits=True)
    name, unit = split_heading(str(first.name))
    return Column(name or str(first.name), unit_of(first.unit) or unit, _reader(file, group, channel))


def _reader(file: Any, group: int, channel: int) -> Callable[[int, int], NDArray[Any]]:
    import numpy as np

    def read(start: int, stop: int) -> NDArray[Any]:
        values, invalid = file.get(
            group=group,
            index=channel,
            samples_only=True,
            ignore_invalidation_bits=True,  # otherwise the library drops those rows, so that lengths differ
            record_offset=start,
            record_count=stop - start,
        )
        array = np.asarray(values)
        if (
            invalid is not None and array.dtype.kind in "fiub"
        ):  # values marked as invalid in the file are missing
            return np.where(np.asarray(invalid, dtype=bool), np.nan, array)
        return array

    return read


def _master(file: Any, group: int) -> Callable[[int, int], NDArray[Any]]:
    import numpy as np

    return lambda start, stop: np.asarray(
        file.get_master(group, record_offset=start, record_count=stop - start), dtype=np.float64
    )


def _started(file: Any, options: Options, remarks: list[str]) -> int | None:
    """Return the nanoseconds from 1970 UTC to time zero of the file; local times by `options`."""
    import numpy as np

    began = _start_of(file.header)
    if began is None:
        return None
    # A start with a zone is an instant; one without is a local time, whose zone only the user knows.
    if began.tzinfo is not None:
        return round(began.timestamp() * 1e6) * 1000
    if options.zone is None:
        remarks.append("its start names no time zone; it is taken as UTC (--zone says otherwise)")
    local = np.array([began], dtype="datetime64[ns]")
    return int(LocalTime(options.zone).to_utc(local).astype(np.int64)[0])


def _start_of(header: Any) -> datetime | None:
    """Return the start as stored in the file, without a zone if it is a local time."""
    if getattr(header, "abs_time", 0) or not hasattr(header, "date"):
        began = getattr(header, "start_time", None)
        return began if isinstance(began, datetime) else None
    try:  # of MDF 3, by a local date; the library takes the zone of this computer, or the present
        text = f"{header.date.decode('ascii')} {header.time.decode('ascii')}"
        return datetime.strptime(text.strip("\0 "), "%d:%m:%Y %H:%M:%S")  # noqa: DTZ007 - a local time
    except (ValueError, AttributeError):
        return None
