"""The newest samples of a run, for a window that opens later."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

#: rows to which small blocks are merged, since each block has an overhead larger than its content
_BLOCK: Final = 2000


class KeptRows:
    """Rows of time and values, of which those of the last `seconds` are kept, and never more than `most`.

    Parameters
    ----------
    width: columns, the first of them time in s, rising.
    """

    def __init__(self, width: int, seconds: float, most: int) -> None:
        self._width = width
        self._seconds = seconds
        self._most = most
        self._blocks: deque[NDArray[np.float64]] = deque()
        self._count = 0

    def append(self, rows: NDArray[np.float64]) -> None:
        """Add rows, shape (n, width), and forget the oldest ones."""
        import numpy as np

        if not len(rows):
            return
        if self._blocks and len(self._blocks[-1]) + len(rows) <= _BLOCK:
            before = self._blocks.pop()
            self._count -= len(before)
            rows = np.concatenate([before, rows])
        self._blocks.append(rows)
        self._count += len(rows)
        begin = self.newest - self._seconds
        while len(self._blocks) > 1 and (
            self._blocks[0][-1, 0] < begin or self._count - len(self._blocks[0]) >= self._most
        ):
            self._count -= len(self._blocks.popleft())

    @property
    def newest(self) -> float:
        """The time of the newest row, s; NaN if there is none."""
        return float(self._blocks[-1][-1, 0]) if self._blocks else float("nan")

    @property
    def oldest(self) -> float:
        """The time of the oldest row, s; NaN if there is none."""
        return float(self._blocks[0][0, 0]) if self._blocks else float("nan")

    def last(self, seconds: float) -> NDArray[np.float64]:
        """The rows of the last `seconds`, shape (n, width)."""
        import numpy as np

        blocks = list(self._blocks)
        if not blocks:
            return np.empty((0, self._width))
        begin = blocks[-1][-1, 0] - seconds
        rows = np.concatenate([block for block in blocks if block[-1, 0] >= begin])[-self._most :]
        return rows[np.searchsorted(rows[:, 0], begin) :]

    def first_value(self, column: int, since: float) -> float | None:
        """The first value of a column from a time on that is a number; None if there is none."""
        for block in self._blocks:
            if block[-1, 0] >= since:
                values = block[(block[:, 0] >= since) & (block[:, column] == block[:, column]), column]
                if len(values):
                    return float(values[0])
        return None
