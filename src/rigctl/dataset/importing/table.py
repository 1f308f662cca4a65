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

#: so many bad rows are listed one by one
_LISTED: Final = 20
#: rows of a part: enough to be fast, few enough that a file of any length fits into memory
PART_ROWS: Final = 1 << 17
#: how a cell says that its value is missing
MISSING: Final = ("", "nan", "NaN", "NAN", "NA", "N/A", "null", "-")


@dataclass(frozen=True)
class Fault:
    """What is wrong with one row; `line` and `column` count from 1, as an editor shows them.

    `group` names the part of the file that the line is counted in, where a file has parts.
    """

    line: int
    what: str
    value: str | None = None
    expected: str | None = None
    column: int | None = None
    group: str = ""

    def error(self, path: Path) -> RigctlError:
        """The fault as a user sees it."""
        where = Location(path, self.line, self.column)
        what = f"in {self.group}: {self.what}" if self.group else self.what
        return RigctlError(what, value=self.value, expected=self.expected, where=where)


@dataclass(frozen=True)
class Heading:
    """The name of a column as it stands in the file: ``position [mm]`` is `position` and `mm`."""

    name: str
    unit: str | None
    where: Location


@dataclass(frozen=True)
class Labels:
    """To which record each row belongs, as the file says it.

    Parameters
    ----------
    codes: place in `texts` of each row's label, shape (n,).
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
    columns: values by the place of their heading, shape (n,); NaN where one is missing.
    lines: in the file, of each of the n rows.
    labels: of the rows' records; None where the file does not tell records apart.
    faults: rows that could not be read; they are not in `columns`.
    group: what the lines are counted in, where the file has parts.
    """

    columns: Mapping[int, NDArray[np.float64]]
    lines: NDArray[np.int64]
    labels: Labels | None = None
    faults: tuple[Fault, ...] = ()
    group: str = ""


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
        """What of the file is not used, one sentence each."""

    def parts(self, wanted: Collection[int], record: int | None) -> Iterator[Part]:
        """The rows in order, read anew.

        Parameters
        ----------
        wanted: places of the columns that hold numbers and are needed.
        record: place of the column that holds the rows' records, as numbers or names.

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

    places: dict[str, int] = {}
    codes = np.array([places.setdefault(text, len(places)) for text in texts], dtype=np.int64)
    return Labels(codes, tuple(places))


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
