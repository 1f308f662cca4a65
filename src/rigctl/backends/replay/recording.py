"""A recorded run, read for playback."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rigctl.errors import RigctlError, nearest_name
from rigctl.json_values import parse_json
from rigctl.rig import Rig

if TYPE_CHECKING:
    from rigctl.dataset import Run


@dataclass(frozen=True, slots=True)
class Switch:
    """A command of the recorded run: time since the first sample, s, actuator and SI value."""

    time: float
    actuator: str
    value: float


@dataclass(frozen=True)
class Recording:
    """The samples of a run in the columns of a rig.

    Parameters
    ----------
    times: s since the first sample, non-decreasing; (n,).
    values: SI, NaN for missing values; (n, channels).
    commands: SI, NaN if not in the run; (n, commands).
    switches: commands with their times, oldest first; empty if not in the run.
    """

    times: NDArray[np.float64]
    values: NDArray[np.float64]
    commands: NDArray[np.float64]
    switches: tuple[Switch, ...] = ()


def read_recording(run: Run, rig: Rig) -> Recording:
    """Read the samples of a run, in the layout of a rig.

    Raises
    ------
    RigctlError
        the run has no samples, or lacks one of the rig's channels.
    """
    recorded = run.layout.columns
    for channel in rig.layout.channels:
        if channel not in recorded:
            raise RigctlError(
                f"run {run.id} has no channel '{channel}', which the rig file asks for",
                expected=f"one of {', '.join(run.layout.channels)}",
                nearest=nearest_name(channel, run.layout.channels),
            )
    recorded_times = np.asarray(run.signals("time"), dtype=float)
    times = continuous_time(recorded_times)
    if not len(times):
        raise RigctlError(f"run {run.id} has no samples to play")
    unknown = np.full(len(times), np.nan)
    return Recording(
        times,
        _columns([run.signals(name) for name in rig.layout.channels], len(times)),
        _columns(
            [run.signals(name) if name in recorded else unknown for name in rig.layout.commands], len(times)
        ),
        _switches(run, recorded_times),
    )


def continuous_time(times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the time since the first sample, s; where it steps back, as in imports whose records all start
    at zero, the next record follows after one median sampling interval."""
    steps = np.diff(times, prepend=times[:1])
    forward = steps[steps > 0.0]
    steps[steps < 0.0] = np.median(forward) if len(forward) else 0.0
    return np.cumsum(steps)


def _switches(run: Run, times: NDArray[np.float64]) -> tuple[Switch, ...]:
    """Return the commands of a run whose samples and events have a common time."""
    if np.any(np.diff(times) < 0.0):
        return ()
    events = run.table("events").select(["time", "kind", "data"]).to_pylist()
    begin = float(times[0])
    with run.event_data():
        commands = [
            (event["time"], parse_json(event["data"])) for event in events if event["kind"] == "command"
        ]
        return tuple(
            Switch(float(time) - begin, data["actuator"], float(data["value"])) for time, data in commands
        )


def _columns(signals: list[NDArray[np.float64]], rows: int) -> NDArray[np.float64]:
    return np.column_stack(signals) if signals else np.empty((rows, 0))
