"""The errors shown to users: where, what, what was expected, and the nearest valid name.

Every mistake that a user can make, and every failure that one can act on, is a `RigctlError`: one message
on the terminal, in a page or in a notebook, and an exit code. A traceback is a fault of rigctl.

The parts of a message are kept apart until it is shown. Code that finds a mistake seldom knows where in a
file it is, so that layers above add the location (`at`); programs are given the parts by name. Texts in a
message come from files and devices, and are made printable once, here.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from difflib import get_close_matches
from enum import IntEnum
from pathlib import Path

from rigctl.printable import printable, shown_path


class ExitCode(IntEnum):
    """Exit status of the process."""

    DONE = 0  #: the work was done, whatever the verdict
    FAILED = 1  #: a step timed out, an interlock tripped, a limit was missed
    USAGE = 2  #: the call or a file is wrong; nothing was created
    INTERRUPTED = 130  #: SIGINT, after the safe cleanup
    TERMINATED = 143  #: SIGTERM or SIGHUP, after the safe cleanup


@dataclass(frozen=True)
class Location:
    """A location in a user's file; line and column count from 1, as in editors.

    `file` is a path, or an address in storage as text, because a path would change ``s3://lab``.
    """

    file: Path | str | None = None
    line: int | None = None
    column: int | None = None

    def __str__(self) -> str:
        parts = [shown_path(self.file), str(self.line or ""), str(self.column or "")]
        return ":".join(part for part in parts if part)

    def or_else(self, other: Location) -> Location:
        """Return this location, with its unknown parts taken from `other`."""
        return Location(self.file or other.file, self.line or other.line, self.column or other.column)


class RigctlError(Exception):
    """A mistake or a failure that a user can act on.

    Parameters
    ----------
    what: one clear sentence, without the location or the value.
    value: the faulty text as written by the user.
    expected: a description of valid values.
    nearest: the nearest valid name, if there is one.
    hint: what to do next.
    where: the location in the user's file.
    exit_code: of the process.
    """

    def __init__(
        self,
        what: str,
        *,
        value: str | None = None,
        expected: str | None = None,
        nearest: str | None = None,
        hint: str | None = None,
        where: Location | None = None,
        exit_code: ExitCode = ExitCode.USAGE,
    ) -> None:
        super().__init__(what)
        self.what = what
        self.value = value
        self.expected = expected
        self.nearest = nearest
        self.hint = hint
        self.where = where or Location()
        self.exit_code = exit_code

    def at(self, where: Location) -> RigctlError:
        """Return this error, with the unknown parts of its location filled in."""
        self.where = self.where.or_else(where)
        return self

    def as_dict(self) -> dict[str, object]:
        """The parts of the message by name, for programs; None for those that are unknown."""
        return {
            "message": str(self),
            "file": shown_path(self.where.file) or None,
            "line": self.where.line,
            "column": self.where.column,
            "what": self.what,
            "value": self.value,
            "expected": self.expected,
            "nearest": self.nearest,
            "hint": self.hint,
        }

    def __str__(self) -> str:
        place = str(self.where)
        text = f"{place}: {self.what}" if place else self.what
        if self.value is not None:
            text += f", got {shorten(self.value)!r}"
        if self.expected:
            text += f"; expected {self.expected}"
        if self.nearest:
            text += f"; did you mean {self.nearest!r}?"
        if self.hint:
            text += f" {self.hint}" if text.endswith("?") else f". {self.hint}"
        return printable(text, keep="\n")


class SeveralErrors(RigctlError):
    """Several mistakes in one file, shown together so that they can be corrected together."""

    def __init__(self, errors: Iterable[RigctlError]) -> None:
        self.errors = tuple(errors)
        first = self.errors[0]
        super().__init__(first.what, where=first.where, exit_code=first.exit_code)

    def at(self, where: Location) -> SeveralErrors:
        """Return these errors, with the unknown parts of each location filled in."""
        for error in self.errors:
            error.at(where)
        super().at(where)
        return self

    def __str__(self) -> str:
        return "\n".join(str(error) for error in self.errors)


def nearest_name(name: str, valid: Iterable[str]) -> str | None:
    """The valid name closest to `name`; None if none is close, or if it is `name` itself.

    Close is a name that contains the other, or has at most a third of its characters changed.
    """
    by_folded = {candidate.casefold(): candidate for candidate in valid if candidate != name}
    folded = name.casefold()
    for match in get_close_matches(folded, list(by_folded), n=3, cutoff=0.6):
        if (
            folded in match
            or match in folded
            or 3 * _changes(folded, match) <= max(len(folded), len(match), 3)
        ):
            return by_folded[match]
    return None


def _changes(first: str, second: str) -> int:
    """The fewest characters to insert, remove, replace or swap with the next to make one of the other."""
    before: list[int] = []
    row = list(range(len(second) + 1))
    for i, one in enumerate(first, 1):
        above, row = row, [i]
        for j, other in enumerate(second, 1):
            cost = min(above[j] + 1, row[j - 1] + 1, above[j - 1] + (one != other))
            if before and j > 1 and one == second[j - 2] and first[i - 2] == other:
                cost = min(cost, before[j - 2] + 1)
            row.append(cost)
        before = above
    return row[-1]


def unknown_name(kind: str, name: str, valid: Iterable[str], *, where: Location | None = None) -> RigctlError:
    """The error for an unknown name, with the nearest valid one or, if they are few, a list of all."""
    names = sorted(valid)
    near = nearest_name(name, names)
    listed = ", ".join(names[:12]) + (", …" if len(names) > 12 else "")
    return RigctlError(
        f"unknown {kind}",
        value=name,
        expected=None if near else f"one of {listed}" if names else None,
        nearest=near,
        where=where,
    )


def require_known(kind: str, names: Iterable[str], valid: Collection[str]) -> None:
    """Refuse the first of `names` that is not one of `valid`, as `unknown_name` words it."""
    for name in names:
        if name not in valid:
            raise unknown_name(kind, name, valid)


def shorten(text: str, width: int = 60) -> str:
    """A value as quoted in a message: on one line, and cut to `width` characters."""
    flat = " ".join(text.split())
    return flat if len(flat) <= width else flat[: width - 1] + "…"
