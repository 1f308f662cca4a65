"""A file's numbers as they stand in it, before anything is known of their meaning."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from rigctl.errors import ExitCode, Location, RigctlError, SeveralErrors

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

#: so many bad rows are listed one by one
_LISTED: Final = 20


@dataclass(frozen=True)
class Fault:
    """What is wrong with one row; `line` and `column` count from 1, as an editor shows them."""

    line: int
    what: str
    value: str | None = None
    expected: str | None = None
    column: int | None = None

    def error(self, path: Path) -> RigctlError:
        """The fault as a user sees it."""
        where = Location(path, self.line, self.column)
        return RigctlError(self.what, value=self.value, expected=self.expected, where=where)


@dataclass(frozen=True)
class Heading:
    """The name of a column as it stands in the file: ``position [mm]`` is `position` and `mm`."""

    name: str
    unit: str | None
    where: Location


@dataclass(frozen=True)
class RawTable:
    """A file's numbers.

    Parameters
    ----------
    headings: one per column.
    columns: values of each, shape (n,); NaN where one is missing.
    lines: in the file, of each of the n rows.
    faults: rows that could not be read; they are not in `columns`.
    """

    path: Path
    headings: tuple[Heading, ...]
    columns: tuple[NDArray[np.float64], ...]
    lines: NDArray[np.int64]
    faults: tuple[Fault, ...] = ()


def refuse(path: Path, faults: Sequence[Fault]) -> RigctlError:
    """All that is wrong with a file, row by row, and how to take in the rest."""
    listed = [fault.error(path) for fault in sorted(faults, key=lambda fault: fault.line)[:_LISTED]]
    more = len(faults) - len(listed)
    rest = f"{len(faults)} bad rows" + (f", {more} of them not listed" if more else "")
    listed.append(
        RigctlError(
            f"nothing was imported: {rest}",
            hint="'--keep-good' leaves them out and imports the others",
            where=Location(path),
            exit_code=ExitCode.USAGE,
        )
    )
    return SeveralErrors(listed)
