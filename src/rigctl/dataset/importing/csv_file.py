"""Comma-separated values with a heading ``name [unit]`` for each column.

Comma, semicolon or tab between the cells; a decimal comma where the cells are divided by something else;
UTF-8, compressed with gzip if the file's name ends in ``.gz``. Lines before the heading that begin with ``#``
are comments. An empty cell, ``nan`` and ``NA`` are missing values.
"""

from __future__ import annotations

import csv
import gzip
import re
import zlib
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TYPE_CHECKING, Final, cast

from rigctl.dataset.importing.csv_rows import Cells, cell_place, decode, read_rows
from rigctl.dataset.importing.headings import split_heading
from rigctl.dataset.importing.table import MISSING, Heading, Labels, Part
from rigctl.errors import Location, RigctlError

if TYPE_CHECKING:
    import numpy as np
    import pyarrow as pa
    from numpy.typing import NDArray

#: bytes of the file that are in memory at a time
_PIECE: Final = 1 << 23
#: bytes of the first rows, which show how numbers are written
_FIRST_ROWS: Final = 1 << 14
#: a first line longer than this is no heading
_LONGEST_HEADING: Final = 1 << 20


@dataclass(frozen=True)
class CsvFile:
    """A file of comma-separated values whose heading has been read.

    Parameters
    ----------
    first_line: the number of the heading's line, from 1.
    """

    path: Path
    headings: tuple[Heading, ...]
    cells: Cells
    first_line: int
    remarks: tuple[str, ...] = ()

    def parts(self, wanted: Collection[int], record: int | None) -> Iterator[Part]:
        """The rows in order; a row that cannot be read is a fault of its part."""
        line = self.first_line + 1
        with _reading(self.path) as file:
            for _ in range(self.first_line):
                file.readline()
            while piece := file.read(_PIECE) + file.readline():
                part = self._read_fast(piece, line, wanted, record)
                yield part or read_rows(self.path, piece, line, self.headings, self.cells, wanted, record)
                line += piece.count(b"\n")

    def _read_fast(self, piece: bytes, line: int, wanted: Collection[int], record: int | None) -> Part | None:
        """All rows of a piece at once; None when one of them needs a closer look."""
        import numpy as np
        import pyarrow as pa

        body = piece.rstrip(b"\r\n")
        if not body:
            return None
        try:
            table = self._parse(body, wanted, record)
        except pa.ArrowInvalid:
            return None
        columns = {place: table[str(place)].to_numpy() for place in wanted}
        if len(table) != body.count(b"\n") + 1 or any(np.isinf(column).any() for column in columns.values()):
            return None
        labels = None if record is None else labels_of_dictionary(table[str(record)])
        return Part(columns, np.arange(line, line + len(table), dtype=np.int64), labels)

    def _parse(self, body: bytes, wanted: Collection[int], record: int | None) -> pa.Table:
        import pyarrow as pa
        from pyarrow import csv as arrow_csv

        types = {str(place): pa.float64() for place in wanted}
        if record is not None:
            types[str(record)] = pa.dictionary(pa.int32(), pa.string())
        return arrow_csv.read_csv(
            pa.BufferReader(body),
            read_options=arrow_csv.ReadOptions(column_names=[str(n) for n in range(len(self.headings))]),
            parse_options=arrow_csv.ParseOptions(delimiter=self.cells.delimiter),
            convert_options=arrow_csv.ConvertOptions(
                column_types=types,
                include_columns=list(types),
                null_values=list(MISSING),
                decimal_point=self.cells.decimal,
            ),
        )


def labels_of_dictionary(column: pa.ChunkedArray) -> Labels:
    """The records of a column of texts, which Arrow has read as a dictionary."""
    import numpy as np
    import pyarrow.compute as pc

    whole = column.unify_dictionaries()
    texts = tuple(whole.chunk(0).dictionary.to_pylist()) if whole.num_chunks else ()
    codes: list[NDArray[np.int32]] = [
        pc.fill_null(chunk.indices, len(texts)).to_numpy(zero_copy_only=False) for chunk in whole.chunks
    ]
    together = np.concatenate(codes) if codes else np.zeros(0, dtype=np.int32)
    return Labels(together.astype(np.int64), (*texts, ""))


def open_csv(path: Path, names: Mapping[str, str]) -> CsvFile:
    """Read the heading of a file of comma-separated values.

    Raises
    ------
    RigctlError
        the file cannot be read, is not UTF-8, or has no heading.
    """
    with _reading(path) as file:
        number, heading = _find_heading(path, file)
        first_rows = file.read(_FIRST_ROWS).decode("utf-8", "replace")
    delimiter = max(",;\t", key=heading.count)
    commas, points = (len(re.findall(rf"\d{sign}\d", first_rows)) for sign in (",", r"\."))
    decimal = "," if delimiter != "," and commas > points else "."
    cells = Cells(delimiter, decimal)
    return CsvFile(path, _read_headings(path, number, heading, cells), cells, number)


def _find_heading(path: Path, file: IO[bytes]) -> tuple[int, str]:
    """The first line that is neither blank nor a comment, and its number."""
    number = 0
    while line := file.readline(_LONGEST_HEADING):
        number += 1
        text = decode(path, line.removeprefix(b"\xef\xbb\xbf") if number == 1 else line, number)
        if text.strip() and not text.startswith("#"):
            return number, text.rstrip("\r\n")
    raise RigctlError(
        "the file has no heading",
        expected="a first line such as 'time [s],position [mm]'",
        where=Location(path),
    )


@contextmanager
def _reading(path: Path) -> Iterator[IO[bytes]]:
    """The file's bytes; what goes wrong is told in plain words, where it is noticed."""
    compressed = path.suffix.lower() == ".gz"
    try:
        with path.open("rb") as file:
            yield cast("IO[bytes]", gzip.GzipFile(fileobj=file)) if compressed else file
    except (gzip.BadGzipFile, EOFError, zlib.error) as problem:
        raise RigctlError("the file is damaged", expected="gzip", where=Location(path)) from problem
    except OSError as problem:
        reason = problem.strerror or str(problem)
        raise RigctlError(f"cannot read the file: {reason}", where=Location(path)) from problem


def _read_headings(path: Path, line: int, heading: str, cells: Cells) -> tuple[Heading, ...]:
    headings = []
    for number, cell in enumerate(next(csv.reader([heading], delimiter=cells.delimiter)), start=1):
        where = Location(path, line, cell_place(heading, cells.delimiter, number))
        name, unit = split_heading(cell)
        if not name:
            raise RigctlError(
                f"column {number} has no name",
                value=cell,
                expected="a name and its unit: name [unit]",
                where=where,
            )
        headings.append(Heading(name, unit, where))
    return tuple(headings)
