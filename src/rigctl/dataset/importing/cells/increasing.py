"""Times of one channel that do not increase: repeated ones are spread or reported, earlier ones are found."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

from rigctl.dataset.importing.options import TimePolicy
from rigctl.dataset.importing.splitting import GAP

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@dataclass(frozen=True)
class Order:
    """The times of one channel, in the order of the file.

    Parameters
    ----------
    times: as they are used, shape (n,).
    rising: which of them are later than all before, shape (n,).
    back: which are earlier than one before; the others repeat a time, as a bus log with coarse stamps does.
    """

    times: NDArray[np.float64]
    rising: NDArray[np.bool_]
    back: NDArray[np.bool_]


def order_of(times: NDArray[np.float64], policy: TimePolicy) -> Order:
    """Return which times of one channel increase; never sorted, since a clock that starts again would mix two
    measurements.
    """
    import numpy as np

    used = spread(times) if policy == "spread" else times
    before = np.maximum.accumulate(np.concatenate([[-np.inf], used]))[:-1]
    return Order(used, used > before, used < before)


def repeated(name: str, count: int, *, line: int) -> str:
    """Return the remark on values of one channel that repeat a time."""
    return (
        f"{name}: {count} values have the time of an earlier one and are left out, the first of them on line "
        f"{line}; '--times spread' keeps them"
    )


def spread(times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Spread equal consecutive times evenly up to the next one; the last ones, and those before a gap, by the
    previous step.

    For loggers that write whole seconds at 10 Hz, for example.
    """
    import numpy as np

    if len(times) < 2:
        return times
    edges = [0, *(np.flatnonzero(times[1:] != times[:-1]) + 1).tolist(), len(times)]
    spaced = times.copy()
    forward = np.diff(times[edges[:-1]])
    usual = float(np.median(forward[forward > 0.0])) if (forward > 0.0).any() else 0.0
    step = 0.0
    for (start, stop), following in zip(pairwise(edges), [*edges[2:], None], strict=True):
        count = stop - start
        ahead = times[stop] - times[start] if following is not None else step * count
        if ahead > GAP * usual > 0.0:  # a pause of the logger, over which its last samples do not extend
            ahead = step * count or usual
        if count > 1 and ahead > 0.0:
            spaced[start:stop] = times[start] + ahead * np.arange(count) / count
        if ahead > 0.0:
            step = ahead / count
    return spaced
