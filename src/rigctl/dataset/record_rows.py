"""Reads the rows of records from the row groups that contain them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

from rigctl.dataset.parquet import numbers

if TYPE_CHECKING:
    import numpy as np
    import pyarrow as pa
    from numpy.typing import NDArray


class RecordRows:
    """Reads the rows of records; in ascending order, every row group is read once.

    Parameters
    ----------
    file: an open Parquet file of samples, with a column ``record``.
    columns: names to read.
    """

    def __init__(self, file: Any, columns: Sequence[str]) -> None:
        self._file = file
        self._columns = list(columns)
        self._held: dict[int, _Group] = {}

    def of(self, record: int) -> pa.Table:
        """Return all rows of a record."""
        import pyarrow as pa

        wanted = [group for group, (low, high) in enumerate(self._ranges) if low <= record <= high]
        self._held = {group: self._held.get(group) or self._read(group) for group in wanted}
        parts = [self._held[group].of(record) for group in wanted]
        if not parts:
            return pa.Table.from_batches([], schema=self._file.schema_arrow).select(self._columns)
        return pa.concat_tables(parts)

    @cached_property
    def _ranges(self) -> list[tuple[float, float]]:
        """Return the smallest and the largest record of every row group."""
        column = self._file.schema_arrow.get_field_index("record")
        ranges = []
        for group in range(self._file.num_row_groups):
            known = self._file.metadata.row_group(group).column(column).statistics
            unbounded = known is None or not known.has_min_max
            ranges.append((-math.inf, math.inf) if unbounded else (known.min, known.max))
        return ranges

    def _read(self, group: int) -> _Group:
        names = list(dict.fromkeys([*self._columns, "record"]))
        table = self._file.read_row_group(group, columns=names)
        return _Group(table.select(self._columns), numbers(table["record"]))


class _Group:
    """A row group, and the starts of its stretches of equal records."""

    def __init__(self, table: pa.Table, records: NDArray[np.int32]) -> None:
        import numpy as np

        self._table = table
        edges = np.flatnonzero(np.diff(records, prepend=np.int32(-2), append=np.int32(-2)))
        self._starts, self._ends = edges[:-1], edges[1:]
        self._records = records[self._starts]

    def of(self, record: int) -> pa.Table:
        """Return its rows of a record."""
        import pyarrow as pa

        indices = (self._records == record).nonzero()[0].tolist()
        parts = [self._table.slice(self._starts[k], self._ends[k] - self._starts[k]) for k in indices]
        return pa.concat_tables(parts) if parts else self._table.slice(0, 0)
