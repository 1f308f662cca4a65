"""LabVIEW's TDMS: each group of channels is a record, units are the channels' property ``unit_string``.

Time is a channel named ``time``, in seconds or as time stamps, or is computed from the channels' waveform
properties (``wf_increment``, ``wf_start_offset``, ``wf_start_time``).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from rigctl.dataset.importing.cells.headings import split_heading, unit_of
from rigctl.dataset.importing.cells.time_column import with_time_column
from rigctl.dataset.importing.columns import CLOCK
from rigctl.dataset.importing.formats.groups import (
    LARGE,
    Column,
    Group,
    GroupedFile,
    Reading,
    clear_errors,
    common_length,
    missing_extra,
    open_groups,
    overheard,
)
from rigctl.dataset.importing.formats.tdms_times import Waveform, starts_of_parts
from rigctl.dataset.importing.options import Options
from rigctl.errors import Location, RigctlError
from rigctl.files.regular import regular

if TYPE_CHECKING:
    from numpy.typing import NDArray

#: first sample and start of each part of a channel, by its path
_Starts = Mapping[str, Sequence[tuple[int, int]]]
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
            open(path, "rb", opener=regular) as raw,
            TdmsFile.open(raw) as file,
        ):
            yield [_group(path, group, options, messages, starts) for group in file.groups()]

    with clear_errors(path, "TDMS"), overheard("nptdms", messages):
        with open(path, "rb", opener=regular) as raw:
            starts = starts_of_parts(raw)
        if path.stat().st_size > LARGE:
            return _opened(path, reading, options, messages, starts)
        # read whole, since the library searches all previous pieces for each piece of a file
        with open(path, "rb", opener=regular) as raw:
            read = TdmsFile.read(raw)
            groups = [_group(path, group, options, messages, starts) for group in read.groups()]
    return _opened(path, lambda: nullcontext(groups), options, messages, starts)


def _opened(
    path: Path, reading: Reading, options: Options, damage: Sequence[str], starts: _Starts
) -> GroupedFile:
    """Return the file; resampled times count from its first start."""
    file = open_groups(path, reading, options, damage=damage)
    if file.clock is not None or not any(heading.name.startswith(CLOCK) for heading in file.headings):
        return file
    began = min((began for parts in starts.values() for _, began in parts), default=None)
    return replace(file, began=began)


def _group(path: Path, group: Any, options: Options, damage: Sequence[str], starts: _Starts) -> Group:
    """Return one group; of a truncated file, the rows that every channel still has."""
    channels = group.channels()
    options = with_time_column(map(_heading, channels), options)
    where = f"group '{group.name}'"
    used = [channel for channel in channels if options.ours(_heading(channel)[0]) != "-"]
    timed = any(options.ours(_heading(channel)[0]) == "time" for channel in channels)
    # A channel of times takes precedence over the properties of a waveform.
    waveforms = {} if timed else _waveforms(used, starts)
    # Different times for each channel are accepted only where they are brought to common ones afterwards.
    if waveforms and options.resample is not None and not damage and _differ(waveforms):
        began = min((began for parts in starts.values() for _, began in parts), default=0)
        return _with_own_clocks(group.name, used, waveforms, options, began)
    lengths = {_heading(channel)[0]: len(channel) for channel in channels}
    # A file that was cut off ends in the middle of a row of channels.
    rows = min(lengths.values(), default=0) if damage else common_length(path, where, lengths, options)
    columns = [Column(*_heading(channel), _reader(channel)) for channel in channels]
    if waveforms:
        columns.insert(0, Column("time", "s", _common_clock(path, where, waveforms)))
    return Group(group.name, rows, tuple(columns))


def _with_own_clocks(
    name: str, channels: Sequence[Any], waveforms: Mapping[str, Waveform], options: Options, began: int
) -> Group:
    """Return a group with the times of each channel beside it, in seconds since `began`."""
    import numpy as np

    rows = max(len(channel) for channel in channels)

    def padded(channel: Any) -> Callable[[int, int], NDArray[Any]]:
        def read(start: int, stop: int) -> NDArray[Any]:
            values = np.asarray(channel[start:stop], dtype=np.float64)
            return np.concatenate([values, np.full(stop - start - len(values), np.nan)])

        return read

    def clock(channel: Any) -> Callable[[int, int], NDArray[Any]]:
        waveform = waveforms[channel.name]
        zero = began if waveform.origin is not None else 0

        def read(start: int, stop: int) -> NDArray[Any]:
            seconds = (waveform.nanoseconds(start, stop) - zero) / 1e9
            return np.where(np.arange(start, stop) < len(channel), seconds, np.nan)

        return read

    known = [channel for channel in channels if channel.name in waveforms]
    columns = [Column("time", "s", clock(known[0]))]
    for channel in known:
        heading, unit = _heading(channel)
        columns.append(Column(heading, unit, padded(channel)))
        columns.append(Column(f"{CLOCK}{options.ours(heading)}", "s", clock(channel)))
    return Group(name, rows, tuple(columns))


def _heading(channel: Any) -> tuple[str, str | None]:
    """Return the name and unit; the unit may be in brackets in the name."""
    name, unit = split_heading(channel.name)
    stored = next((channel.properties[key] for key in _UNITS if channel.properties.get(key)), None)
    return name or channel.name, unit_of(stored) or unit


def _reader(channel: Any) -> Callable[[int, int], NDArray[Any]]:
    import numpy as np

    return lambda start, stop: np.asarray(channel[start:stop])


def _waveforms(channels: Sequence[Any], starts: _Starts) -> dict[str, Waveform]:
    """Return the times of the channels that have them, by name."""
    found = {}
    for channel in channels:
        if not channel.properties.get("wf_increment"):
            continue
        step = float(channel.properties["wf_increment"])
        offset = float(channel.properties.get("wf_start_offset", 0.0))
        parts: Sequence[tuple[int, int | None]] = starts.get(channel.path) or [(0, None)]
        found[channel.name] = Waveform(step, offset, tuple(parts))
    return found


def _differ(waveforms: Mapping[str, Waveform]) -> bool:
    """Return whether the channels are sampled at different times."""
    first, *others = waveforms.values()
    return any(not _same(first, other) for other in others)


def _same(one: Waveform, other: Waveform) -> bool:
    if (one.step, one.offset, len(one.parts)) != (other.step, other.offset, len(other.parts)):
        return False
    pairs = zip(one.parts, other.parts, strict=True)
    limit = _SAME * one.step * 1e9
    return all(a == b and abs((x or 0) - (y or 0)) <= limit for (a, x), (b, y) in pairs)


def _common_clock(
    path: Path, where: str, waveforms: Mapping[str, Waveform]
) -> Callable[[int, int], NDArray[Any]]:
    """Return the times that all channels of a group share.

    Raises
    ------
    RigctlError
        the channels have different steps, or start at different times.
    """
    import numpy as np

    (first, wave), *_ = waveforms.items()
    steps = {(one.step, one.offset) for one in waveforms.values()}
    if len(steps) > 1:
        raise RigctlError(
            f"in {where}: its channels are sampled at different times",
            value=", ".join(f"every {step:g} s from {offset:g} s on" for step, offset in sorted(steps)),
            expected="one rate for all channels of a group, or a channel 'time'",
            hint=f"Bring them to the same times: --resample '{min(step for step, _ in steps):g} s', say",
            where=Location(path),
        )
    for name, other in waveforms.items():
        if not _same(wave, other):
            began, expected = other.origin, wave.origin
            raise RigctlError(
                f"in {where}: its channels start at different times",
                value=f"{name} at {_shown(began)}" + _again(other),
                expected=f"{_shown(expected)} as of {first}" + _again(wave),
                hint=f"Bring them to the same times, --resample '{wave.step:g} s', or leave it out, "
                f"--columns '{name}=-'",
                where=Location(path),
            )

    def times(start: int, stop: int) -> NDArray[Any]:
        instants = wave.nanoseconds(start, stop)
        return np.asarray(instants / 1e9) if wave.origin is None else instants.astype("datetime64[ns]")

    return times


def _shown(nanoseconds: int | None) -> str:
    import numpy as np

    if nanoseconds is None:
        return "an unknown time"
    return str(np.datetime_as_string(np.datetime64(nanoseconds, "ns"), unit="us"))


def _again(waveform: Waveform) -> str:
    count = len(waveform.parts) - 1
    return f", and again {count} times" if count else ""
