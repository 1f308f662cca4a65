"""The cylinder's stroke in a record: the main result of an open-loop campaign."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rigctl.report.run_data import Measured, RecordData, RunData, Signal
from rigctl.units import convert, parse_unit

#: time over which the position is averaged, before the valve opens and after the piston has come to rest;
#: also the settling time after the valve has closed, s
REST = 0.2
#: the command at which nothing moves
NEUTRAL = 0.0


@dataclass(frozen=True)
class Motion:
    """The signals of an extension: `command` at `value` moves what `position` reads."""

    position: Signal
    command: Signal
    value: float = 1.0


def find_motion(run: RunData) -> Motion | None:
    """The extension on this bench: by the rig's role, or else the only position and valve."""
    role = run.rig.roles.extend if run.rig else None
    if run.rig and role and role.position and {role.position, role.actuator} <= run.signals.keys():
        value = run.rig.actuators[role.actuator].read(role.value)
        return Motion(run.signals[role.position], run.signals[role.actuator], value)
    length = parse_unit("m").dimension
    positions = [
        signal for signal in run.signals.values() if signal.dimension == length and not signal.command
    ]
    valves = [signal for signal in run.signals.values() if signal.command and _is_valve(signal)]
    return Motion(positions[0], valves[0]) if len(positions) == 1 and len(valves) == 1 else None


def _in_unit(measured: Measured, unit: str) -> float | None:
    if not math.isfinite(measured.value):
        return None
    return convert(measured.value, measured.unit, unit) if measured.unit != unit else measured.value


def _is_valve(signal: Signal) -> bool:
    """True for a command that takes both directions and no intermediate value but neutral."""
    return {-1.0, 1.0} <= set(np.unique(signal.values[~np.isnan(signal.values)])) <= {-1.0, 0.0, 1.0}


def stroke(run: RunData, record: RecordData, motion: Motion) -> float | None:
    """End minus start of a record's first extension, in the position's unit: as the procedure measured it.

    If the procedure has no measure of that name, it is computed from the position.
    The start is the mean position over the last `REST` before the valve opens. The end is the mean from
    `REST` to 2 `REST` after it has closed: the piston has come to rest, and leakage has not yet moved it.
    Where the next command follows sooner, the last sample before it counts.

    Returns
    -------
    None if the record has no complete extension.
    """
    measured = [one for one in record.measures if one.name == "stroke"]
    if measured:
        return _in_unit(measured[-1], motion.position.unit)
    time = run.time[record.rows]
    position = motion.position.values[record.rows]
    command = motion.command.values[record.rows]
    extending = command == motion.value
    if not extending.any():
        return None
    opens = int(extending.argmax())
    after = np.flatnonzero(~extending[opens:])
    if not len(after):
        return None
    closes = opens + int(after[0])
    others = np.flatnonzero(command[closes:] != NEUTRAL)
    leaves = closes + int(others[0]) if len(others) else len(command)
    before = (time >= time[opens] - REST) & (time < time[opens])
    settled = (time >= time[closes] + REST) & (time < time[closes] + 2.0 * REST)
    settled[leaves:] = False
    start = _mean(position[before], position[opens])
    end = _mean(position[settled], position[leaves - 1])
    return end - start if np.isfinite(end - start) else None


def _mean(values: np.ndarray, otherwise: float) -> float:
    present = values[~np.isnan(values)]
    return float(present.mean()) if len(present) else float(otherwise)
