"""Parquet with columns named ``name [unit]``, or named plainly with the unit in the field's metadata."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rigctl.dataset.importing.cells.headings import split_heading, unit_of
from rigctl.dataset.importing.cells.local_time import LocalTime
from rigctl.dataset.importing.cells.time_column import with_time_column
from rigctl.dataset.importing.cells.times import ArrayClock, array_clock
from rigctl.dataset.importing.formats.csv_file import labels_of_dictionary
from rigctl.dataset.importing.formats.table import PART_ROWS, Heading, Labels, RowBlock, labels_of_numbers
from rigctl.dataset.importing.options import Options
from rigctl.errors import Location, RigctlError

if TYPE_CHECKING:
    import numpy as np
    import pyarrow as pa
    import pyarrow.parquet as pq
    from numpy.typing import NDArray


@dataclass(frozen=True)
class ParquetFile:
    """A Parquet file whose schema has been read; line n is its n-th row."""

    path: Path
    headings: tuple[Heading, ...]
    names: tuple[str, ...]  #: names of the columns in the file
    clock: ArrayClock | None = None  #: clock of absolute times
    zone: str | None = None  #: time zone of time stamps without one
    remarks: tuple[str, ...] = ()

    @property
    def origin(self) -> int | None:
        """Return the nanoseconds from 1970 UTC to time zero; None if the times are not absolute."""
        return None if self.clock is None else self.clock.origin

    def parts(self, wanted: Collection[int], record: int | None) -> Iterator[RowBlock]:
        """The rows in order."""
        import numpy as np

        indices = [*wanted] if record is None else [*wanted, record]
        local = LocalTime(self.zone)
        with _reading(self.path) as file:
            line = 1
            for batch in file.iter_batches(PART_ROWS, columns=[self.names[index] for index in indices]):
                columns = {index: self._numbers(batch[self.names[index]], index, local) for index in wanted}
                labels = None if record is None else self._labels(batch[self.names[record]], record, local)
                yield RowBlock(columns, np.arange(line, line + len(batch), dtype=np.int64), labels)
                line += len(batch)

    def _numbers(self, column: pa.Array, index: int, local: LocalTime) -> NDArray[np.float64]:
        import pyarrow as pa

        if self.clock is not None and self.headings[index].seconds:
            return self.clock.seconds(_times(column, local))
        try:
            numbers: NDArray[np.float64] = column.cast(pa.float64()).to_numpy(zero_copy_only=False)
        except pa.ArrowException as problem:
            raise no_numbers(self.path, self.headings[index].name, str(column.type)) from problem
        return numbers

    def _labels(self, column: pa.Array, index: int, local: LocalTime) -> Labels:
        import pyarrow as pa

        if pa.types.is_dictionary(column.type):
            column = column.dictionary_decode()
        if pa.types.is_integer(column.type):  # of any size
            column = column.cast(pa.string())
        if pa.types.is_string(column.type) or pa.types.is_large_string(column.type):
            return labels_of_dictionary(pa.chunked_array([column.dictionary_encode()]))
        return labels_of_numbers(self._numbers(column, index, local))


def open_parquet_file(path: Path, options: Options) -> ParquetFile:
    """Read the headings of a Parquet file.

    Raises
    ------
    RigctlError
        the file is missing or damaged.
    """
    headings: list[Heading] = []
    clock = None
    with _reading(path) as file:
        schema = file.schema_arrow
    for field in schema:
        name, unit = split_heading(field.name)
        stored = (field.metadata or {}).get(b"unit")
        if unit is None and stored is not None:
            unit = unit_of(stored.decode("utf-8", "replace"))
        headings.append(Heading(name or field.name, unit, Location(path)))
    options = with_time_column(((heading.name, heading.unit) for heading in headings), options)
    ours = [options.ours(heading.name) for heading in headings]
    if "time" in ours:
        index = ours.index("time")
        clock = _find_clock(path, schema.names[index], headings[index], options)
        if clock is not None:
            headings[index] = replace(headings[index], unit="s", seconds=True)
    return ParquetFile(path, tuple(headings), tuple(schema.names), clock, options.zone)


def _find_clock(path: Path, name: str, heading: Heading, options: Options) -> ArrayClock | None:
    """Detect the clock from the first times; None for elapsed times."""
    with _reading(path) as file:
        batch = next(file.iter_batches(PART_ROWS, columns=[name]), None)
    unit = options.unit_of(heading.name) or heading.unit
    return None if batch is None else array_clock([_times(batch[name], LocalTime(options.zone))], unit)


def _times(column: pa.Array, local: LocalTime) -> NDArray[Any]:
    """Return time stamps or numbers as a NumPy array."""
    import numpy as np
    import pyarrow as pa

    if pa.types.is_date(column.type):
        column = column.cast(pa.timestamp("ns"))
    if pa.types.is_timestamp(column.type):
        stamps = np.asarray(column.cast(pa.timestamp("ns")).to_numpy(zero_copy_only=False))
        return stamps if column.type.tz is not None else local.to_utc(stamps)
    return np.asarray(column.to_numpy(zero_copy_only=False))


def no_numbers(path: Path, name: str, kind: str) -> RigctlError:
    """Return the error for a column that does not contain numbers."""
    return RigctlError(
        f"{name}: the column holds no numbers",
        value=kind,
        hint=f"Leave it out: --columns '{name}=-'",
        where=Location(path),
    )


@contextmanager
def _reading(path: Path) -> Iterator[pq.ParquetFile]:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with pq.ParquetFile(path) as file:
            yield file
    except (OSError, pa.ArrowException, ValueError, LookupError) as problem:  # also names that are not text
        missing = isinstance(problem, FileNotFoundError)
        what = "there is no such file" if missing else "the file is no Parquet file, or it is damaged"
        raise RigctlError(what, where=Location(path)) from problem
