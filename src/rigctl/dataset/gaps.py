"""Gaps: time steps inside a record that are much longer than the others."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

#: a time step longer than the usual one by this factor is a gap
GAP: Final = 2.5


@dataclass(frozen=True)
class Gap:
    """The longest of `count` gaps: its length and its start, s."""

    count: int
    length: float
    start: float


def find_gap(times: NDArray[np.float64]) -> Gap | None:
    """Return the longest gap in the increasing times of a record, s; None if there is none."""
    steps = np.diff(times)
    if not len(steps):
        return None
    wide = np.flatnonzero(steps > GAP * float(np.median(steps)))
    if not len(wide):
        return None
    longest = wide[np.argmax(steps[wide])]
    return Gap(len(wide), float(steps[longest]), float(times[longest]))
