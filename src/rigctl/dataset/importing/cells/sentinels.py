"""Numbers by which loggers mark a missing value: -9999, 32767 and the like, where they cannot be readings.

They may also be readings, so that the whole column is looked at before one of them is taken for a mark:
`Sentinels` collects during a first pass, and only a second pass leaves them out
(`rigctl.dataset.importing.stages`). A mark is one if it is far from every other value of its column, or
in a column of times, if it is negative and no other time is. The user has the last word: `--missing`.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final

from rigctl.dataset.importing.cells.missing_values import NO_NUMBER
from rigctl.dataset.importing.formats.table import KEPT_FAULTS, Fault, RowBlock, cut

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

#: numbers that loggers write for a missing value; 6999 and 7999 are those of Campbell's
MARKS: Final = (
    *(-999.0, -999.9, -9999.0, -9999.9, -99999.0, -999999.0),
    *(-999.9000244140625, -9999.900390625),  # as a file of 32-bit numbers stores them
    *(9999.0, 99999.0, 999999.0, -32768.0, 32767.0, 6999.0, -6999.0, 7999.0, -7999.0),
)
#: a mark is no reading if it is this many times as large as every other value of its column
_FAR: Final = 5.0
#: values of a column without which nothing is known of it
_FEWEST: Final = 3


@dataclass
class Sentinels:
    """The marks among the values of some columns, collected part by part.

    Parameters
    ----------
    columns: indices of the columns that may have marks.
    times: those of them that are times of the rows, or of a channel.
    """

    columns: Sequence[int]
    times: Collection[int] = ()
    _counts: dict[int, dict[float, int]] = field(default_factory=dict)
    _others: dict[int, tuple[int, float]] = field(default_factory=dict)
    _negative: set[int] = field(default_factory=set)

    def take(self, part: RowBlock) -> None:
        """Look at the next rows."""
        import numpy as np

        for index in self.columns:
            values = part.columns[index]
            present = values[np.isfinite(values) & ~np.isin(values, NO_NUMBER)]
            # All that is kept of a column: how often each mark occurs, and the number and the size of the
            # other values.
            marked = np.isin(present, MARKS)
            counts = self._counts.setdefault(index, {})
            for mark, count in zip(*np.unique(present[marked], return_counts=True), strict=True):
                counts[float(mark)] = counts.get(float(mark), 0) + int(count)
            number, largest = self._others.get(index, (0, 0.0))
            if (present[~marked] < 0.0).any():
                self._negative.add(index)
            rest = np.abs(present[~marked])
            self._others[index] = (
                number + len(rest), max(largest, float(rest.max())) if len(rest) else largest
            )  # fmt: skip

    def found(self) -> dict[int, dict[float, int]]:
        """Return how often each mark is in each column in which it cannot be a reading."""
        result = {}
        for index, counts in self._counts.items():
            number, largest = self._others[index]
            far = {
                mark: count
                for mark, count in counts.items()
                # a command that is otherwise zero may have been 9999 once
                if (abs(mark) >= _FAR * largest and (largest > 0.0 or mark < 0.0))
                # times count from zero, unless others of them are negative too
                or (index in self.times and index not in self._negative and mark < 0.0)
            }
            if far and number >= _FEWEST:
                result[index] = far
        return result


def blanked(part: RowBlock, marks: Mapping[int, Iterable[float]]) -> RowBlock:
    """Return the rows without the values that are marks of their column."""
    columns = dict(part.columns)
    for index, numbers in marks.items():
        columns[index] = without(columns[index], numbers)
    return replace(part, columns=columns)


def without_marked_times(part: RowBlock, marks: Mapping[int, Iterable[float]], name: str) -> RowBlock:
    """Return the rows whose times are none of their column's marks; the others become faults.

    Parameters
    ----------
    marks: by the index of a column of times.
    name: of the times, for messages.
    """
    import numpy as np

    for index, numbers in marks.items():
        times = part.columns[index]
        marked = np.isin(times, list(numbers))
        if not marked.any():
            continue
        faults = [
            Fault(
                int(part.lines[row]),
                f"{name}: a mark of a missing value",
                f"{times[row]:g}",
                "a time; '--missing none' takes it for one",
                group=part.group,
                path=part.path,
            )
            for row in np.flatnonzero(marked)[:KEPT_FAULTS].tolist()
        ]
        more = part.more_faults + int(marked.sum()) - len(faults)
        ordered = sorted((*part.faults, *faults), key=lambda fault: fault.line)
        part = replace(cut(part, ~marked), faults=tuple(ordered), more_faults=more)
    return part


def without(values: NDArray[np.float64], numbers: Iterable[float]) -> NDArray[np.float64]:
    """Return the values, NaN for those that are one of the numbers."""
    import numpy as np

    marked = np.isin(values, list(numbers))
    return np.where(marked, np.nan, values) if marked.any() else values


def remark(name: str, counts: Mapping[float, int]) -> str:
    """Return the remark on the marks of a column."""
    total = sum(counts.values())
    shown = ", ".join(f"{mark:g}" for mark in sorted(counts))
    verb = "1 value is" if total == 1 else f"{total} values are"
    return f"{name}: {verb} {shown}, a mark of a missing value, and left out; '--missing none' keeps them"
