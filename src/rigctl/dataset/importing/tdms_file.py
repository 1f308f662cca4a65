"""LabVIEW's TDMS: each group of channels is a record, units are the channels' property ``unit_string``.

Time is a channel named ``time``, in seconds or as time stamps, or is computed from the channels' waveform
properties (``wf_increment``, ``wf_start_offset``).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from rigctl.dataset.importing.groups import (
    LARGE,
    Column,
    Group,
    GroupedFile,
    clear_errors,
    common_length,
    missing_extra,
    open_groups,
    overheard,
)
from rigctl.dataset.importing.headings import split_heading, unit_of
from rigctl.dataset.importing.options import Options
from rigctl.dataset.importing.time_column import with_time_column
from rigctl.errors import Location, RigctlError

if TYPE_CHECKING:
    from numpy.typing import NDArray

#: properties in which programs store the unit of a channel
_UNITS: Final = ("unit_string", "NI_UnitDescription", "unit", "Unit")


#: starts of channels that differ by less than this part of a step are the same
_SAME: Final = 0.1


def open_tdms(path: Path, options: Options) -> GroupedFile:
    """Read a TDMS file.

    Raises
    ------
    RigctlError
        npTDMS is not installed, the file cannot be read, or its groups are not records.
    """
    try:
        from nptdms import TdmsFile
    except ImportError as problem:
        raise missing_extra("tdms", "npTDMS", path) from problem

    messages: list[str] = []

    @contextmanager
    def reading() -> Iterator[Sequence[Group]]:
        with (
            clear_errors(path, "TDMS"),
            overheard("nptdms", messages),
            path.open("rb") as raw,
            TdmsFile.open(raw) as file,
        ):
            yield [_group(path, group, options, messages) for group in file.groups()]

    with clear_errors(path, "TDMS"), overheard("nptdms", messages):
        if path.stat().st_size > LARGE:
            return open_groups(path, reading, options, damage=messages)
        # read whole, since the library searches all previous pieces for each piece of a file
        with path.open("rb") as raw:
            groups = [_group(path, group, options, messages) for group in TdmsFile.read(raw).groups()]
    return open_groups(path, lambda: nullcontext(groups), options, damage=messages)


def _group(path: Path, group: Any, options: Options, damage: Sequence[str]) -> Group:
    """Return one group; of a truncated file, the rows that every channel still has."""
    channels = group.channels()
    options = with_time_column(map(_heading, channels), options)
    where = f"group '{group.name}'"
    lengths = {_heading(channel)[0]: len(channel) for channel in channels}
    rows = min(lengths.values(), default=0) if damage else common_length(path, where, lengths, options)
    columns = [Column(*_heading(channel), _reader(channel)) for channel in channels]
    used = [channel for channel in channels if options.ours(_heading(channel)[0]) != "-"]
    timed = any(options.ours(name) == "time" for name in lengths)
    if not timed and (clock := _waveform_time(path, where, used)) is not None:
        columns.insert(0, Column("time", "s", clock))
    return Group(group.name, rows, tuple(columns))


def _heading(channel: Any) -> tuple[str, str | None]:
    """Return the name and unit; the unit may be in brackets in the name."""
    name, unit = split_heading(channel.name)
    stored = next((channel.properties[key] for key in _UNITS if channel.properties.get(key)), None)
    return name or channel.name, unit_of(stored) or unit


def _reader(channel: Any) -> Callable[[int, int], NDArray[Any]]:
    import numpy as np

    return lambda start, stop: np.asarray(channel[start:stop])


def _waveform_time(
    path: Path, where: str, channels: Sequence[Any]
) -> Callable[[int, int], NDArray[Any]] | None:
    """Return the equidistant times stored with every channel of a waveform; None if there are none.

    Raises
    ------
    RigctlError
        the channels have different steps, or start at different times.
    """
    import numpy as np

    steps = {
        (float(c.properties["wf_increment"]), float(c.properties.get("wf_start_offset", 0.0)))
        for c in channels
        if c.properties.get("wf_increment")
    }
    if not steps:
        return None
    if len(steps) > 1:
        raise RigctlError(
            f"in {where}: its channels are sampled at different times",
            value=", ".join(f"every {step:g} s from {offset:g} s on" for step, offset in sorted(steps)),
            expected="one rate for all channels of a group, or a channel 'time'",
            where=Location(path),
        )
    ((step, offset),) = steps
    starts = {
        channel.name: np.datetime64(channel.properties["wf_start_time"], "ns")
        for channel in channels
        if channel.properties.get("wf_start_time")
    }
    first, began = next(iter(starts.items()), ("", None))
    for name, start in starts.items():
        if began is not None and abs((start - began) / np.timedelta64(1, "s")) > _SAME * step:
            raise RigctlError(
                f"in {where}: its channels start at different times",
                value=f"{name} at {np.datetime_as_string(start, unit='us')}",
                expected=f"{np.datetime_as_string(began, unit='us')} as of {first}",
                hint=f"Leave it out: --columns '{name}=-'",
                where=Location(path),
            )

    def times(start: int, stop: int) -> NDArray[Any]:
        seconds = offset + step * np.arange(start, stop)
        if began is None:
            return np.asarray(seconds, dtype=np.float64)
        return began + np.round(seconds * 1e9).astype("timedelta64[ns]")

    return times
