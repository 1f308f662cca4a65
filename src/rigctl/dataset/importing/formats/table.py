"""A file's numbers as written, before their meaning is known.

Between the readers of formats, which know how a file is built, and the import, which knows the rig: every
format becomes a `Source` with headings and blocks of rows. Rows that cannot be read are `Fault`s with
their line, and are not in the blocks.

A source yields its rows again for each pass. The first pass checks them all and collects what a record
has in common, which is known only after its last row; the second writes. A file of any length is so
imported completely or not at all, without being held in memory.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Final, Protocol

from rigctl.errors import ExitCode, Location, RigctlError, SeveralErrors
from rigctl.wording import number_of

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

#: bad rows that are stored individually
KEPT_FAULTS: Final = 1000
#: bad rows that are listed individually
_LISTED: Final = 20
#: message on a row at or before the time of the previous row
NOT_INCREASING: Final = "time: it does not increase within a record"
#: message on a value before the time of the previous value of its channel
GOES_BACK: Final = "time: it goes back within a channel"
#: of a command that its actuator cannot have taken
BEYOND_LIMITS: Final = "beyond the limits of the actuator"
#: columns of a table: more of them are cells that were not separated as the file meant, or no table at all
MOST_COLUMNS: Final = 2000
#: rows of a part: many for speed, but few enough for files of any length
PART_ROWS: Final = 1 << 17


@dataclass(frozen=True)
class Fault:
    """A fault of one row; `line` and `column` count from 1, as in an editor.

    `group` is the part of the file in which lines are counted, if it has parts; `path` the file, if there are
    several.
    """

    line: int
    what: str
    value: str | None = None
    expected: str | None = None
    column: int | None = None
    group: str = ""
    path: Path | None = None

    def error(self, path: Path) -> RigctlError:
        """Return the fault as an error message."""
        where = Location(self.path or path, self.line or None, self.column)
        what = f"in {self.group}: {self.what}" if self.group else self.what
        return RigctlError(what, value=self.value, expected=self.expected, where=where)


@dataclass(frozen=True)
class Heading:
    """The heading of a column in the file: ``position [mm]`` is `position` and `mm`.

    `seconds` is true for times that are read as seconds regardless of the heading: dates, clocks, epochs;
    `spent` for a column that is part of another one: the date beside a time of day.
    """

    name: str
    unit: str | None
    where: Location
    seconds: bool = False
    spent: bool = False


@dataclass(frozen=True)
class Labels:
    """The record to which each row belongs, according to the file.

    Parameters
    ----------
    codes: index in `texts` of each row's label, shape (n,).
    named: the texts are names of groups, so that a number is a name too.
    """

    codes: NDArray[np.int64]
    texts: tuple[str, ...]
    named: bool = False


@dataclass(frozen=True)
class RowBlock:
    """Some consecutive rows of a file.

    Parameters
    ----------
    columns: values by the index of their heading, shape (n,); NaN where one is missing.
    lines: line in the file of each of the n rows.
    labels: of the rows' records; None if the file does not distinguish records.
    faults: rows that could not be read; they are not in `columns`.
    group: part of the file in which lines are counted, if it has parts.
    more_faults: number of unreadable rows beyond those in `faults`.
    path: of the file, if there are several.
    """

    columns: Mapping[int, NDArray[np.float64]]
    lines: NDArray[np.int64]
    labels: Labels | None = None
    faults: tuple[Fault, ...] = ()
    group: str = ""
    more_faults: int = 0
    path: Path | None = None


class Source(Protocol):
    """A file whose headings have been read; its rows are read again for each pass."""

    @property
    def path(self) -> Path:
        """The file."""

    @property
    def headings(self) -> tuple[Heading, ...]:
        """One per column."""

    @property
    def remarks(self) -> tuple[str, ...]:
        """Remarks on unused parts of the file and on assumptions, one sentence each."""

    @property
    def origin(self) -> int | None:
        """Nanoseconds from 1970-01-01 UTC to time zero; None if the times are not absolute."""

    def parts(self, wanted: Collection[int], record: int | None) -> Iterator[RowBlock]:
        """Yield the rows in order, read again for each call.

        Parameters
        ----------
        wanted: indices of the numeric columns that are needed.
        record: index of the column with the records, as numbers or names.

        Raises
        ------
        RigctlError
            the file cannot be read, or a wanted column is not numeric.
        """


def cut(part: RowBlock, rows: NDArray[np.bool_] | slice) -> RowBlock:
    """Return some of the rows of a part."""
    labels = part.labels and Labels(part.labels.codes[rows], part.labels.texts, part.labels.named)
    columns = {index: values[rows] for index, values in part.columns.items()}
    return replace(part, columns=columns, lines=part.lines[rows], labels=labels)


def labels_of_numbers(values: NDArray[np.float64]) -> Labels:
    """Return labels from record numbers; NaN is the missing label."""
    import numpy as np

    known = np.where(np.isnan(values), -1.0, values)
    changes = np.concatenate([known[:1] == known[:1], known[1:] != known[:-1]])
    return Labels(np.cumsum(changes) - 1, tuple(f"{value:.17g}" for value in known[changes].tolist()))


def labels_of_texts(texts: Sequence[str]) -> Labels:
    """Return labels from texts, one for each row."""
    import numpy as np

    indices: dict[str, int] = {}
    codes = np.array([indices.setdefault(text, len(indices)) for text in texts], dtype=np.int64)
    return Labels(codes, tuple(indices))


def require_few_columns(path: Path, count: int, line: int | None) -> None:
    """Refuse a text file or a sheet with more columns than any log has: each is examined by itself.

    Raises
    ------
    RigctlError
        there are too many.
    """
    if count > MOST_COLUMNS:
        raise RigctlError(
            "the table has too many columns",
            value=f"{count} columns",
            expected=f"at most {MOST_COLUMNS}, in rows of values with a name for each column",
            hint="Exchange rows and columns if they are transposed, or divide it into several files",
            where=Location(path, line),
        )


def refuse(path: Path, faults: Sequence[Fault], count: int, *, imports: bool = True) -> RigctlError:
    """Return the error for a file with `count` bad rows, row by row, and how to import the rest.

    Parameters
    ----------
    imports: by `rigctl import`, which alone can leave rows out.
    """
    listed = [fault.error(path) for fault in faults[:_LISTED]]
    hint = (
        "'rigctl import --keep-good' imports the other rows"
        if imports
        else "Correct these rows, or leave them out"
    )
    if any(fault.what == NOT_INCREASING for fault in faults):
        hint += "; '--times drop', 'spread' or 'split' deals with these times"
    elif any(fault.what == GOES_BACK for fault in faults):
        hint += "; '--times drop' leaves these values out, with a remark"
    beyond = next((fault.what for fault in faults if fault.what.endswith(BEYOND_LIMITS)), None)
    if beyond is not None:
        name = beyond.partition(":")[0]
        hint += (
            f"; '--missing VALUE' marks a number as missing, --columns 'THEIRS={name} [UNIT]' states another "
            "unit, and 'low' and 'high' in the rig file are the limits"
        )
    more = count - len(listed)
    rest = number_of(count, "bad row") + (f", {more} of them not listed" if more else "")
    listed.append(
        RigctlError(
            f"nothing was imported: {rest}",
            hint=hint,
            where=Location(path),
            exit_code=ExitCode.USAGE,
        )
    )
    return SeveralErrors(listed)
