"""Comma-separated values with a heading ``name [unit]`` for each column.

Cells are separated by comma, semicolon, tab, bar or spaces; the decimal sign is a point or a comma; the
encoding is UTF-8, UTF-16 or one of Windows; files named ``.gz`` are compressed with gzip. Lines before the
heading that begin with ``#`` are comments. An empty cell, ``nan``, ``---`` and the marks of instruments are
missing values.

A piece of some MiB is read at once by Arrow where every row is plain (`_read_fast`), which is many times
faster; if a single one is not, the whole piece is read row by row
(`rigctl.dataset.importing.formats.csv_rows`), which alone knows what is wrong with which row. Both must
give the same numbers for what both can read.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

from rigctl.dataset.importing.cells.missing_values import NO_VALUE
from rigctl.dataset.importing.cells.numbers import Thousands, ambiguous_sign
from rigctl.dataset.importing.cells.time_column import with_time_column
from rigctl.dataset.importing.cells.times import TimeFormat, TimeReader, find_format
from rigctl.dataset.importing.formats.csv_rows import Cells, read_rows, split_rows, with_times
from rigctl.dataset.importing.formats.dialect import SAMPLE_ROWS, Dialect, find_dialect
from rigctl.dataset.importing.formats.table import Heading, Labels, RowBlock
from rigctl.dataset.importing.formats.text import HEAD, Lines, TextForm, find_form, not_text, opened
from rigctl.dataset.importing.options import Options
from rigctl.errors import Location, RigctlError

if TYPE_CHECKING:
    import numpy as np
    import pyarrow as pa
    from numpy.typing import NDArray

#: cells without a number up to which the decimal sign is looked for; such a file is refused for its rows
_MOST_OTHERS: Final = 100_000
#: lines at most before the data
_MOST_LINES: Final = 20_000


@dataclass(frozen=True)
class CsvFile:
    """A CSV file whose heading has been read.

    Parameters
    ----------
    lines: number of lines up to and including the heading.
    time: format of its times; None for plain numbers, or without a time.
    origin: see `Source`.
    """

    path: Path
    headings: tuple[Heading, ...]
    cells: Cells
    form: TextForm
    lines: int
    time: TimeFormat | None = None
    origin: int | None = None
    remarks: tuple[str, ...] = ()

    def parts(self, wanted: Collection[int], record: int | None) -> Iterator[RowBlock]:
        """Yield the rows in order; a row that cannot be read is a fault of its part."""
        clock = None if self.time is None else TimeReader(self.time, self.origin)
        with opened(self.path) as file:
            lines = Lines(self.path, file, self.form)
            lines.skip(self.lines)
            for line, piece in lines.pieces():
                yield self._read_fast(piece, line, wanted, record, clock) or self._read_slowly(
                    piece, line, wanted, record, clock
                )

    def texts(self, index: int) -> Iterator[tuple[Sequence[str], NDArray[np.int64]]]:
        """Yield the cells of a column as text, part by part, with their lines."""
        for part in self.parts((), index):
            labels = part.labels
            if labels is not None:
                yield [labels.texts[code] for code in labels.codes.tolist()], part.lines

    def _read_slowly(
        self, piece: bytes, line: int, wanted: Collection[int], record: int | None, clock: TimeReader | None
    ) -> RowBlock:
        """Read the rows of a piece one by one."""
        text = self._decoded(piece, line)
        try:
            return read_rows(text, line, self.headings, self.cells, wanted, record, clock)
        except RigctlError as problem:
            raise problem.at(Location(self.path, problem.where.line)) from None

    def cell_texts(self, indices: Sequence[int]) -> Iterator[tuple[dict[int, list[str]], Sequence[int]]]:
        """Yield the cells of some columns as texts, part by part, with their lines."""
        with opened(self.path) as file:
            lines = Lines(self.path, file, self.form)
            lines.skip(self.lines)
            for line, piece in lines.pieces():
                rows = list(split_rows(self._decoded(piece, line), line, self.cells.delimiter))
                wide = [(at, cells) for at, cells in rows if len(cells) > max(indices, default=0)]
                columns = {index: [cells[index].strip() for _, cells in wide] for index in indices}
                yield columns, [at for at, _ in wide]

    def _decoded(self, piece: bytes, line: int) -> str:
        try:
            return piece.decode("utf-8")
        except UnicodeDecodeError as problem:
            at = line + piece.count(b"\n", 0, problem.start)
            raise not_text(self.path, "utf-8", at) from problem

    def _read_fast(
        self, piece: bytes, line: int, wanted: Collection[int], record: int | None, clock: TimeReader | None
    ) -> RowBlock | None:
        """Read all rows of a piece at once; None if one of them must be read individually."""
        import numpy as np
        import pyarrow as pa

        body = piece.rstrip(b"\r\n")
        # What Arrow would read otherwise than `read_rows` is left to that.
        if not body or body.startswith(b"#") or b"\n#" in body:  # a comment, or a mark such as #N/A
            return None
        if body.count(b'"', body.rfind(b"\n") + 1) % 2:  # the file may be cut off within a cell
            return None
        if self.cells.delimiter == " ":
            body = re.sub(rb"(?m)^ +| +(?=\r?$)", b"", re.sub(rb"[ \t]+", b" ", body))
        times = self.cells.time if clock is not None else ()
        numbers = [index for index in wanted if index not in times]
        try:
            table = self._parse(body, numbers, record, times if wanted else ())
        except (pa.ArrowInvalid, pa.ArrowKeyError):
            return None
        columns = {index: table[str(index)].to_numpy() for index in numbers}
        # A row more or less than lines: a quoted line end, or a blank line, so that line numbers would be
        # wrong.
        if len(table) != body.count(b"\n") + 1 or any(np.isinf(column).any() for column in columns.values()):
            return None
        labels = None if record is None else labels_of_dictionary(table[f"record {record}"])
        part = RowBlock(columns, np.arange(line, line + len(table), dtype=np.int64), labels)
        if clock is None or not wanted:
            return part
        return self._timed(part, table, clock)

    def _timed(self, part: RowBlock, table: pa.Table, clock: TimeReader) -> RowBlock | None:
        """Add the times of the rows; None if one must be read individually."""
        import pyarrow.compute as pc

        columns = [table[f"time {index}"] for index in self.cells.time]
        written = columns[0] if len(columns) == 1 else pc.binary_join_element_wise(*columns, " ")
        # The clock has gone on to the end of the part; it is set back before the rows are read one by one.
        before = clock.state
        seconds, wrong = clock.read(pc.fill_null(written, "").combine_chunks())
        if wrong.any():
            clock.state = before
            return with_times(part, written.to_pylist(), self.headings, self.cells, clock)
        return replace(part, columns={**part.columns, self.cells.time[-1]: seconds})

    def _parse(
        self, body: bytes, numbers: Collection[int], record: int | None, times: Collection[int]
    ) -> pa.Table:
        import pyarrow as pa
        from pyarrow import csv as arrow_csv

        names = [f"time {index}" if index in times else str(index) for index in range(len(self.headings))]
        types = {names[index]: pa.float64() for index in numbers}
        types |= {names[index]: pa.string() for index in times}
        if record is not None:
            names[record] = f"record {record}"
            types[names[record]] = pa.dictionary(pa.int32(), pa.string())
        return arrow_csv.read_csv(
            pa.BufferReader(body),
            read_options=arrow_csv.ReadOptions(column_names=names),
            parse_options=arrow_csv.ParseOptions(delimiter=self.cells.delimiter),
            convert_options=arrow_csv.ConvertOptions(
                column_types=types,
                include_columns=list(types),
                null_values=list(self.cells.missing),
                strings_can_be_null=True,
                decimal_point=self.cells.decimal,
            ),
        )


def labels_of_dictionary(column: pa.ChunkedArray) -> Labels:
    """Return the labels of a text column that Arrow has read as a dictionary."""
    import numpy as np
    import pyarrow.compute as pc

    unified = column.unify_dictionaries()
    texts = tuple(unified.chunk(0).dictionary.to_pylist()) if unified.num_chunks else ()
    codes: list[NDArray[np.int32]] = [
        pc.fill_null(chunk.indices, len(texts)).to_numpy(zero_copy_only=False) for chunk in unified.chunks
    ]
    together = np.concatenate(codes) if codes else np.zeros(0, dtype=np.int32)
    return Labels(together.astype(np.int64), (*texts, ""))


def open_csv(path: Path, options: Options) -> CsvFile:
    """Read the heading of a CSV file, and detect the format of the rest.

    Raises
    ------
    RigctlError
        the file cannot be read, has no heading, or its times are ambiguous.
    """
    # 1. Bytes to text. 2. The form of the table.
    form = find_form(path, options.encoding)
    head, complete = _head(path, form)
    dialect = find_dialect(path, head, options, complete=complete)
    remarks = list(dialect.remarks)
    if form.guessed:
        remarks.append("the file is not UTF-8; it is read as Windows-1252 (--encoding says otherwise)")
    # 3. The time, which may be two columns, or a text.
    headings, indices, time = _find_time(path, dialect, options)
    origin = None
    if time is not None and time.absolute:
        clock = TimeReader(time)
        clock.read(_joined(dialect, indices))
        origin = clock.origin
        if time.kind == "date" and time.naive and time.zone is None:
            remarks.append("its times name no time zone; they are taken as UTC (--zone says otherwise)")
    missing = frozenset((*NO_VALUE, *options.missing))
    stated = options.decimal is not None
    cells = Cells(
        dialect.delimiter, dialect.decimal, missing, indices, stated, dialect.repeats, dialect.fractions
    )
    file = CsvFile(path, headings, cells, form, dialect.lines, time, origin, tuple(remarks))
    # 4. What the decimal sign may mean, from all rows: 1.011 below 978 may be a thousand.
    if stated or _decimal_sign_is_clear(file, dialect, options, complete=complete):
        return file
    doubt = f"'{dialect.decimal}' is taken for the decimal sign (--decimal says otherwise)"
    return replace(file, remarks=(*file.remarks, f"many cells are no numbers; {doubt}"))


def _decimal_sign_is_clear(file: CsvFile, dialect: Dialect, options: Options, *, complete: bool) -> bool:
    """Return whether the whole file was examined for what its decimal sign may mean.

    Raises
    ------
    RigctlError
        ``1.011`` stands below ``978``, without another number that shows what the point means.
    """
    everything = True
    used = [index for index, one in enumerate(file.headings) if options.ours(one.name) != "-"]
    check = Thousands(dialect.decimal)
    for row in dialect.sample:
        cells = {index: [row.cells[index].strip()] for index in used if index < len(row.cells)}
        check.take(cells, [row.line])
    # The first rows did not settle it, and are not all: the others may.
    if not check.settled and not (complete and len(dialect.sample) < SAMPLE_ROWS):
        check = Thousands(dialect.decimal)
        for cells, lines in file.cell_texts(used):
            check.take(cells, lines)
            everything = check.others <= _MOST_OTHERS
            if check.settled or not everything:
                break
    found = check.ambiguous()
    if found is not None:
        index, line, cell, whole = found
        name = file.headings[index].name
        raise ambiguous_sign(name, cell, whole, dialect.decimal, Location(file.path, line))
    return everything or check.settled


def _head(path: Path, form: TextForm) -> tuple[str, bool]:
    """Return the first lines of the file, and whether they are all."""
    lines_read: list[bytes] = []
    size = 0
    with opened(path) as file:
        lines = Lines(path, file, form)
        while line := lines.next():
            lines_read.append(line)
            size += len(line)
            if size > HEAD or len(lines_read) > _MOST_LINES:
                return b"".join(lines_read).decode("utf-8", "replace"), False
    return b"".join(lines_read).decode("utf-8", "replace"), True


def _find_time(
    path: Path, dialect: Dialect, options: Options
) -> tuple[tuple[Heading, ...], tuple[int, ...], TimeFormat | None]:
    """Return the headings, the indices of the cells that form the time, and its format; None for numbers."""
    headings = dialect.headings
    options = with_time_column(((heading.name, heading.unit) for heading in headings), options)
    ours = [options.ours(heading.name) for heading in headings]
    if "time" not in ours:
        return headings, (), None
    index = ours.index("time")
    heading = headings[index]
    unit = options.unit_of(heading.name) or heading.unit
    where = dialect.location_of(path, index)
    times = dialect.column(index)
    missing = {*NO_VALUE, *options.missing}
    known = [cell for cell in times if cell not in missing]
    indices: tuple[int, ...] = (index,)
    if "date" in ours and any(":" in cell for cell in known):
        indices = (ours.index("date"), index)
        known = [f"{day} {hour}" for day, hour in zip(dialect.column(indices[0]), times, strict=True)]
    form = find_format(known, unit, options, path, where)
    if form.kind == "number":
        return headings, (), None
    changed = list(headings)
    changed[index] = replace(heading, unit="s", seconds=True)
    if len(indices) > 1:
        changed[indices[0]] = replace(headings[indices[0]], spent=True)
    return tuple(changed), indices, form


def _joined(dialect: Dialect, indices: Sequence[int]) -> pa.Array:
    """Return the time texts of the first rows."""
    import pyarrow as pa

    columns = [dialect.column(index) for index in indices]
    return pa.array([" ".join(cells) for cells in zip(*columns, strict=True)], pa.string())
