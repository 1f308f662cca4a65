"""ASAM MDF 4 (and 3): each channel group is a record; time is its master, units are the channels' own."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rigctl.dataset.importing.groups import (
    LARGE,
    Column,
    Group,
    GroupedFile,
    held,
    missing_extra,
    open_groups,
    overheard,
    telling,
)
from rigctl.dataset.importing.headings import split_heading, unit_of
from rigctl.dataset.importing.options import Options

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

    said: list[str] = []
    origins: list[int | None] = []

    @contextmanager
    def reading() -> Iterator[Sequence[Group]]:
        # opened here, since the library creates a missing file and leaves damaged ones open
        with telling(path, "MDF"), overheard("asammdf", said), path.open("rb") as raw, MDF(raw) as file:
            origins.append(_started(file))
            yield _groups(file)

    with telling(path, "MDF"):
        small = path.stat().st_size <= LARGE
    if small:
        with reading() as groups:
            kept = [held(group) for group in groups]
        found = open_groups(path, lambda: nullcontext(kept), options, "channel group", said)
    else:
        found = open_groups(path, reading, options, "channel group", said)
    return replace(found, began=origins[0])


def _groups(file: Any) -> list[Group]:
    found: list[Group] = []
    for index, group in enumerate(file.groups):
        rows = int(group.channel_group.cycles_nr)
        if not rows:
            continue
        master = file.masters_db.get(index)
        columns = [
            _column(file, index, channel) for channel in range(len(group.channels)) if channel != master
        ]
        if master is not None:
            columns = [column for column in columns if column.name != "time"]  # the master is the time
            columns.insert(0, Column("time", "s", _master(file, index)))
        found.append(Group(_name(group, index, {other.name for other in found}), rows, tuple(columns)))
    return found


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
        found = np.asarray(values)
        if (
            invalid is not None and found.dtype.kind in "fiub"
        ):  # values marked as invalid in the file are missing
            return np.where(np.asarray(invalid, dtype=bool), np.nan, found)
        return found

    return read


def _master(file: Any, group: int) -> Callable[[int, int], NDArray[Any]]:
    import numpy as np

    return lambda start, stop: np.asarray(
        file.get_master(group, record_offset=start, record_count=stop - start), dtype=np.float64
    )


def _started(file: Any) -> int | None:
    """Return the nanoseconds from 1970 UTC to time zero of the file."""
    began = getattr(file.header, "start_time", None)
    if not isinstance(began, datetime):
        return None
    return round(began.astimezone(UTC).timestamp() * 1e6) * 1000
