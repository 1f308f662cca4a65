"""What a recorded run holds, as the player needs it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rigctl.errors import RigctlError, nearest_name
from rigctl.rig import Rig

if TYPE_CHECKING:
    from rigctl.dataset import Run


@dataclass(frozen=True)
class Recording:
    """Samples of a run in the columns of a rig.

    Parameters
    ----------
    times: s since the first sample, never falling; (n,).
    values: SI, NaN where a channel gave none; (n, channels).
    commands: SI, NaN where the run does not know them; (n, commands).
    """

    times: NDArray[np.float64]
    values: NDArray[np.float64]
    commands: NDArray[np.float64]


def read_recording(run: Run, rig: Rig) -> Recording:
    """The samples of a run, for a rig with these channels.

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
    times = continuous_time(np.asarray(run.signals("time"), dtype=float))
    if not len(times):
        raise RigctlError(f"run {run.id} has no samples to play")
    unknown = np.full(len(times), np.nan)
    return Recording(
        times,
        _columns([run.signals(name) for name in rig.layout.channels], len(times)),
        _columns(
            [run.signals(name) if name in recorded else unknown for name in rig.layout.commands], len(times)
        ),
    )


def continuous_time(times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Time since the first sample; where it goes back, as in an import whose records each start at zero, the
    next record follows after one usual step."""
    steps = np.diff(times, prepend=times[:1])
    forward = steps[steps > 0.0]
    steps[steps < 0.0] = np.median(forward) if len(forward) else 0.0
    return np.cumsum(steps)


def _columns(signals: list[NDArray[np.float64]], rows: int) -> NDArray[np.float64]:
    return np.column_stack(signals) if signals else np.empty((rows, 0))
