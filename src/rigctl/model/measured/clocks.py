"""What a clock that may be off leaves of a record, and which clocks cannot be unknowns."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from rigctl.errors import RigctlError
from rigctl.model.measured.record import MeasuredRecord, Measurements
from rigctl.model.reading_errors import ClockError
from rigctl.units import show


def clocks_of(measurements: Measurements) -> list[ClockError]:
    """The clocks whose offsets are unknowns."""
    return [one for one in measurements.reading_errors if isinstance(one, ClockError)]


def require_long_records(measurements: Measurements) -> None:
    """Refuse a clock of which a record is too short to tell anything, or that dates steps of an input.

    Raises
    ------
    RigctlError
        the first of them, by name.
    """
    for clock in clocks_of(measurements):
        held = [name for name in clock.channels if name in _held(measurements)]
        if held:
            raise RigctlError(
                f"the clock '{clock.clock}' dates an input that holds until its next reading",
                value=held[0],
                expected="inputs that change continuously between readings, or outputs",
                hint=f"Take {held[0]} out of the clock's channels",
            )
        for record in _dated(clock, measurements.records):
            length = float(record.times[-1] - record.times[0])
            if length <= 2.0 * clock.largest:
                raise RigctlError(
                    f"the clock '{clock.clock}' may be off by more than a quarter of record {record.label}",
                    value=f"±{show(clock.stated, 's')}",
                    expected=f"less than ±{show(0.25 * length, 's')}",
                    hint="'rigctl runs exclude' leaves a record out of every analysis",
                )


def clock_reach(measurements: Measurements, record: MeasuredRecord) -> float:
    """How far from its switch an edge may be dated in a record, s."""
    return max((one.stated for one in clocks_of(measurements) if one.acts_in(record.run)), default=0.0)


def clock_notes(measurements: Measurements) -> Iterator[str]:
    """Which readings do not count because of a clock."""
    for clock in clocks_of(measurements):
        outputs = ", ".join(_affected(clock, measurements))
        off = f"{behind_text(clock.offset)}, ±" if clock.offset else "may be off by ±"
        yield (
            f"the clock {clock.clock} {off}{show(clock.stated, 's')}: the readings of {outputs} "
            "within twice that of an end of a record count in no fit"
        )


def behind_text(offset: float) -> str:
    """``is 12 ms behind``, or ``is 12 ms ahead``."""
    unit = "ms" if abs(offset) < 1.0 else "s"
    return f"is {show(abs(offset), unit, digits=3)} {'behind' if offset > 0.0 else 'ahead'}"


def far_from_ends(measurements: Measurements) -> list[NDArray[np.bool_]]:
    """(n, outputs) of each record, the readings that belong to it whatever offset a fit may find.

    What an output was before it, and a measured input before its first reading, is not known. The stated
    offset of a clock moves the first or the last reading of an input into the record.
    """
    # by the largest offset that a fit may find, not by what it found: the same readings must count at every
    # step
    masks = [np.ones(record.values.shape, dtype=bool) for record in measurements.records]
    for clock in clocks_of(measurements):
        columns = [measurements.outputs.index(name) for name in _affected(clock, measurements)]
        known = clock.offset if any(name in measurements.inputs for name in clock.channels) else 0.0
        for record, mask in zip(measurements.records, masks, strict=True):
            if not record.row and clock.acts_in(record.run):
                first = record.times[0] + clock.largest + max(known, 0.0)
                last = record.times[-1] - clock.largest + min(known, 0.0)
                mask[:, columns] &= ((record.times >= first) & (record.times <= last))[:, None]
    return masks


def _affected(clock: ClockError, measurements: Measurements) -> list[str]:
    """The outputs that a clock dates, or all if it dates an input."""
    every = any(name in measurements.inputs for name in clock.channels)
    return [name for name in measurements.outputs if every or name in clock.channels]


def _held(measurements: Measurements) -> set[str]:
    """The measured inputs that change in steps in some record."""
    return {
        name
        for k, name in enumerate(measurements.inputs)
        for record in measurements.records
        if k not in record.along and np.ptp(record.inputs[:, k]) > 0.0
    }


def _dated(clock: ClockError, records: Sequence[MeasuredRecord]) -> list[MeasuredRecord]:
    return [one for one in records if not one.row and clock.acts_in(one.run)]
