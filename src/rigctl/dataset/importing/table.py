"""A file's numbers as they stand in it, before anything is known of their meaning."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final, Protocol

from rigctl.errors import ExitCode, Location, RigctlError, SeveralErrors

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

#: so many bad rows are kept one by one
KEPT_FAULTS: Final = 1000
#: so many bad rows are listed one by one
_LISTED: Final = 20
#: rows of a part: enough to be fast, few enough that a file of any length fits into memory
PART_ROWS: Final = 1 << 17
#: how a cell says that its value is missing, and how a row says that it belongs to no record
MISSING: Final = (
    "",
    "nan",
    "NaN",
    "NAN",
    "NA",
    "N/A",
    "n/a",
    "#N/A",
    "#NV",
    "null",
    "NULL",
    "-",
    "--",
    "---",
)
#: how loggers and instruments say that there is no value: nothing connected, too large, an error
NO_VALUE: Final = (
    *MISSING,
    *("----", "-----", "None", "none", "?", "*", "***", "bad", "Bad", "BAD", "invalid", "Invalid", "INVALID"),
    *(
        "err",
        "Err",
        "ERR",
        "error",
        "Error",
        "ERROR",
        "#ERROR",
        "#VALUE!",
        "#DIV/0!",
        "#REF!",
        "open",
        "OPEN",
    ),
    *(
        "OL",
        "O.L",
        "O.L.",
        "+OL",
        "-OL",
        "OVL",
        "OVLD",
        "OVER",
        "Over",
        "+OVER",
        "-OVER",
        "OVERLOAD",
        "Overload",
    ),
    *("overload", "OVERFLOW", "Overflow", "overflow", "OVERRANGE", "Overrange", "OVER RANGE", "Over Range"),
)
#: numbers by which SCPI instruments say overload and no value
NO_NUMBER: Final = (9.9e37, -9.9e37, 9.91e37)


@dataclass(frozen=True)
class Fault:
    """What is wrong with one row; `line` and `column` count from 1, as an editor shows them.

    `group` names the part of the file that the line is counted in, where a file has parts; `path` the file,
    where there are several.
    """

    line: int
    what: str
    value: str | None = None
    expected: str | None = None
    column: int | None = None
    group: str = ""
    path: Path | None = None

    def error(self, path: Path) -> RigctlError:
        """The fault as a user sees it."""
        where = Location(self.path or path, self.line or None, self.column)
        what = f"in {self.group}: {self.what}" if self.group else self.what
        return RigctlError(what, value=self.value, expected=self.expected, where=where)


@dataclass(frozen=True)
class Heading:
    """The name of a column as it stands in the file: ``position [mm]`` is `position` and `mm`.

    `seconds` is true for times that are read as seconds, whatever the heading says: dates, clocks, epochs;
    `spent` for a column that is read as a part of another one: the date beside a time of day.
    """

    name: str
    unit: str | None
    where: Location
    seconds: bool = False
    spent: bool = False


@dataclass(frozen=True)
class Labels:
    """To which record each row belongs, as the file says it.

    Parameters
    ----------
    codes: index in `texts` of each row's label, shape (n,).
    named: the texts are names of groups, and a number among them is a name too.
    """

    codes: NDArray[np.int64]
    texts: tuple[str, ...]
    named: bool = False


@dataclass(frozen=True)
class Part:
    """Some consecutive rows of a file.

    Parameters
    ----------
    columns: values by the index of their heading, shape (n,); NaN where one is missing.
    lines: in the file, of each of the n rows.
    labels: of the rows' records; None where the file does not tell records apart.
    faults: rows that could not be read; they are not in `columns`.
    group: what the lines are counted in, where the file has parts.
    more_faults: how many more rows could not be read than `faults` tells.
    path: of the file, where there are several.
    """

    columns: Mapping[int, NDArray[np.float64]]
    lines: NDArray[np.int64]
    labels: Labels | None = None
    faults: tuple[Fault, ...] = ()
    group: str = ""
    more_faults: int = 0
    path: Path | None = None


class Source(Protocol):
    """A file whose headings have been read; its rows are read anew whenever they are asked for."""

    @property
    def path(self) -> Path:
        """The file."""

    @property
    def headings(self) -> tuple[Heading, ...]:
        """One per column."""

    @property
    def remarks(self) -> tuple[str, ...]:
        """What of the file is not used, or was taken for granted, one sentence each."""

    @property
    def origin(self) -> int | None:
        """Nanoseconds from 1970-01-01 UTC to time zero; None where the times say nothing of the calendar."""

    def parts(self, wanted: Collection[int], record: int | None) -> Iterator[Part]:
        """The rows in order, read anew.

        Parameters
        ----------
        wanted: indices of the columns that hold numbers and are needed.
        record: index of the column that holds the rows' records, as numbers or names.

        Raises
        ------
        RigctlError
            the file cannot be read, or a wanted column holds no numbers.
        """


def labels_of_numbers(values: NDArray[np.float64]) -> Labels:
    """Records given as numbers; NaN is the missing label."""
    import numpy as np

    known = np.where(np.isnan(values), -1.0, values)
    changes = np.concatenate([known[:1] == known[:1], known[1:] != known[:-1]])
    return Labels(np.cumsum(changes) - 1, tuple(f"{value:.17g}" for value in known[changes].tolist()))


def labels_of_texts(texts: Sequence[str]) -> Labels:
    """Records given as texts, one for each row."""
    import numpy as np

    indices: dict[str, int] = {}
    codes = np.array([indices.setdefault(text, len(indices)) for text in texts], dtype=np.int64)
    return Labels(codes, tuple(indices))


def refuse(path: Path, faults: Sequence[Fault], count: int) -> RigctlError:
    """All that is wrong with a file, row by row, and how to take in the rest; `count` rows are bad in all."""
    listed = [fault.error(path) for fault in faults[:_LISTED]]
    more = count - len(listed)
    rest = f"{count} bad row{'' if count == 1 else 's'}" + (f", {more} of them not listed" if more else "")
    listed.append(
        RigctlError(
            f"nothing was imported: {rest}",
            hint="'--keep-good' imports the other rows",
            where=Location(path),
            exit_code=ExitCode.USAGE,
        )
    )
    return SeveralErrors(listed)
