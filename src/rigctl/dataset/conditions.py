"""The operating points of imported records."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

#: temperatures that differ by at most this are one condition, K
SAME_TEMPERATURE: Final = 1.0


def cluster(values: Sequence[float], width: float = SAME_TEMPERATURE) -> list[float]:
    """Replace each value by the median of its cluster; a cluster spans at most `width`.

    Clusters are formed from the lowest value upwards; NaN stays NaN.
    """
    order = sorted((index for index, value in enumerate(values) if value == value), key=lambda i: values[i])  # noqa: PLR0124
    centres = list(values)
    start = 0
    while start < len(order):
        stop = start
        while stop < len(order) and values[order[stop]] - values[order[start]] <= width:
            stop += 1
        members = order[start:stop]
        lower, upper = values[members[(len(members) - 1) // 2]], values[members[len(members) // 2]]
        for index in members:
            centres[index] = 0.5 * (lower + upper)
        start = stop
    return centres
