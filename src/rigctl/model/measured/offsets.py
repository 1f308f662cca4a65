"""A record at the times at which its readings were taken, where the rig file says how far a clock is off.

A clock that is behind by τ gives a reading at t + τ the time t. Each reading is moved by what the rig file
states for τ, into a row of its own where the others of its row are not moved with it. What that takes beyond
an end of the record is left out, since the commands there are not known. Switches keep their times.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from rigctl.errors import RigctlError
from rigctl.rig.clock import Clock
from rigctl.units import show

Floats = NDArray[np.float64]

#: decimals of a second to which times are rounded: two that differ by rounding alone are one row
_DECIMALS = 9


def stated_offsets(clocks: Mapping[str, Clock]) -> dict[str, float]:
    """How far the clock of each channel is behind, s, where a rig file says so."""
    return {name: one.offset for one in clocks.values() if one.offset for name in one.channels}


def as_taken(times: Floats, values: Floats, late: Sequence[float], label: str) -> tuple[Floats, Floats]:
    """The rows of a record, ordered by the times at which their values were taken.

    Parameters
    ----------
    times, values: (n) and (n, outputs) as they were dated.
    late: (outputs) how much later each was taken, s.

    Raises
    ------
    RigctlError
        less than half of the record would be left.
    """
    if not any(late):
        return times, values
    length = float(times[-1] - times[0])
    farthest = max(late, key=abs)
    if abs(farthest) > 0.5 * length:
        raise RigctlError(
            f"a clock is off by more than half of record {label}",
            value=show(farthest, "s"),
            expected=f"less than {show(0.5 * length, 's')}",
            hint="'rigctl runs exclude' leaves a record out of every analysis",
        )
    taken = np.round(times[:, None] + np.asarray(late), _DECIMALS)
    first, last = np.round(times[[0, -1]], _DECIMALS)
    # a row for each time at which anything was read; the ends stay, since commands are known from the one to
    # the other
    kept = np.isfinite(values) & (taken >= first) & (taken <= last)
    every = np.union1d(taken[kept], [first, last])
    moved = np.full((every.size, values.shape[1]), np.nan)
    for k in range(values.shape[1]):
        moved[np.searchsorted(every, taken[kept[:, k], k]), k] = values[kept[:, k], k]
    return every, moved


def moved_lines(knots: Floats, lines: Floats, late: Sequence[float]) -> tuple[Floats, Floats]:
    """Inputs that were read at `knots` by clocks that are behind by `late`, at the times of the commands."""
    if not any(late):
        return knots, lines
    every = np.unique(knots[:, None] + np.asarray(late))
    columns = [np.interp(every, knots + one, line) for one, line in zip(late, lines.T, strict=True)]
    return every, np.column_stack(columns)
