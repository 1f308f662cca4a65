"""Steps of time inside a record that are much longer than the others."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

#: a step of time this much longer than usual is a gap
GAP: Final = 2.5


@dataclass(frozen=True)
class Gap:
    """The longest of `count` steps of time that are longer than usual: its length and where it begins, s."""

    count: int
    length: float
    start: float


def find_gap(times: NDArray[np.float64]) -> Gap | None:
    """The longest gap in the rising times of a record, s; None where there is none."""
    steps = np.diff(times)
    if not len(steps):
        return None
    wide = np.flatnonzero(steps > GAP * float(np.median(steps)))
    if not len(wide):
        return None
    longest = wide[np.argmax(steps[wide])]
    return Gap(len(wide), float(steps[longest]), float(times[longest]))
