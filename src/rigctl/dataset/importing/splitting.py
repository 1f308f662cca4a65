"""Splits a file into records: at commands, at gaps in time, or by a column.

In: the rows of a whole file, or of one of its groups. Out: the same rows with labels; nothing is moved or
left out. A file that has records already is divided within each of them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Final

from rigctl.dataset.importing.columns import Assigned
from rigctl.dataset.importing.formats.table import Labels, RowBlock
from rigctl.errors import RigctlError, unknown_name
from rigctl.units import read_si

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

#: a time step longer than the usual one by this factor ends a record
GAP: Final = 10.0
#: samples before a command that belong to its record, so that the initial state is known
LEAD: Final = 10
_WAYS: Final = ("command", "gap", "column")


@dataclass(frozen=True)
class Split:
    """How to split records: the method, and the name or the length after the colon."""

    way: str
    what: str | None = None


def read_split(text: str | None) -> Split | None:
    """Read ``command``, ``command:NAME``, ``gap``, ``gap:10 s`` or ``column:NAME``.

    Raises
    ------
    RigctlError
        the text is none of them.
    """
    if text is None:
        return None
    way, colon, what = (part.strip() for part in text.partition(":"))
    if way not in _WAYS or (way == "column" and not what) or (colon and not what):
        raise RigctlError(
            "--split: no such way",
            value=text,
            expected="command, command:NAME, gap, 'gap:10 s' or column:NAME",
        )
    if way == "gap" and what:
        read_si(what, "s")
    return Split(way, what or None)


def split_rows(
    part: RowBlock, split: Split, assigned: Sequence[Assigned], headings: Mapping[str, int]
) -> RowBlock:
    """Return the rows of a whole file with labels of its records.

    Parameters
    ----------
    headings: indices of the columns by their names in the file.

    Raises
    ------
    RigctlError
        there is no such column, or no command.
    """
    if split.way == "column":
        return _by_column(part, split.what or "", assigned, headings)
    ours = {column.name: column for column in assigned}
    time = ours["time"]
    times = part.columns[time.index]
    if split.way == "gap":
        longest = None
        if split.what is not None:
            longest = read_si(split.what, "s") / (time.unit.factor if time.unit is not None else 1.0)
        return begin_records(part, lambda rows: _after_gaps(times[rows], longest))
    commands = {name: column.index for name, column in ours.items() if column.kind == "command"}
    if split.what is not None and split.what not in commands:
        raise unknown_name("command to split by", split.what, commands)
    if not commands:
        raise RigctlError("--split command: the file has no command", expected="a column of an actuator")
    indices = [commands[split.what]] if split.what is not None else list(commands.values())
    values = [part.columns[index] for index in indices]
    return begin_records(part, lambda rows: _at_commands([column[rows] for column in values]))


def split_at_restarts(part: RowBlock, time: int) -> RowBlock:
    """Return the rows of a whole file, with a new record wherever time goes back."""
    times = part.columns[time]
    return begin_records(part, lambda rows: _after_gaps(times[rows], float("inf")))


def begin_records(part: RowBlock, find: Callable[[slice], NDArray[np.bool_]]) -> RowBlock:
    """Divide every record of the file at the rows that `find` returns.

    The second part of record ``A`` is named ``A 2``; the parts of a file without records are numbered.
    """
    import numpy as np

    rows = len(part.lines)
    codes = np.zeros(rows, dtype=np.int64)
    texts: list[str] = []
    for start, stop, text in stretches(part):
        if text is not None and text.strip() in ("", "-1"):  # between records
            codes[start:stop] = len(texts)
            texts.append("")
            continue
        starts = find(slice(start, stop))
        # The first row begins a record anyway.
        starts[0] = False
        edges = [start, *(start + np.flatnonzero(starts)).tolist(), stop]
        for number, (first, last) in enumerate(pairwise(edges), start=1):
            codes[first:last] = len(texts)
            undivided = len(edges) == 2
            texts.append(f"{number - 1}" if text is None else text if undivided else f"{text} {number}")
    return replace(part, labels=Labels(codes, tuple(texts)))


def stretches(part: RowBlock) -> list[tuple[int, int, str | None]]:
    """Yield the first row, the row after the last and the label of every stretch with one label."""
    import numpy as np

    rows = len(part.lines)
    if part.labels is None:
        return [(0, rows, None)] if rows else []
    codes = part.labels.codes
    edges = (np.flatnonzero(codes[1:] != codes[:-1]) + 1).tolist()
    return (
        [(start, stop, part.labels.texts[int(codes[start])]) for start, stop in pairwise([0, *edges, rows])]
        if rows
        else []
    )


def _after_gaps(times: NDArray[np.float64], longest: float | None) -> NDArray[np.bool_]:
    """Return rows before which time goes back, or steps by over `longest` or `GAP` times the usual step."""
    import numpy as np

    starts = np.zeros(len(times), dtype=bool)
    known = np.flatnonzero(~np.isnan(times))
    steps = np.diff(times[known])
    if longest is None:
        forward = steps[steps > 0.0]
        longest = GAP * float(np.median(forward)) if len(forward) else float("inf")
    starts[known[1:]] = (steps < 0.0) | (steps > longest)
    return starts


def _at_commands(commands: Sequence[NDArray[np.float64]]) -> NDArray[np.bool_]:
    """Return rows shortly before a command leaves its rest value (its first one), except for the first time.

    `LEAD` rows before the command belong to its record, but at most half of those since the commands last
    returned to rest.
    """
    import numpy as np

    rows = len(commands[0])
    moved = np.zeros(rows, dtype=bool)
    for values in commands:
        held = _held(values)
        known = held[~np.isnan(held)]
        if len(known):
            moved |= ~np.isnan(held) & (held != known[0])
    starts = np.zeros(rows, dtype=bool)
    leaves = np.flatnonzero(moved[1:] & ~moved[:-1]) + 1
    comes = np.flatnonzero(~moved[1:] & moved[:-1]) + 1
    # The first command needs no division: the file begins there.
    for row in leaves[1:].tolist():
        quiet = row - int(comes[comes < row][-1])
        starts[row - min(LEAD, max(quiet // 2, 1))] = True
    return starts


def _held(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return values with each missing one replaced by the last one before it."""
    import numpy as np

    known = ~np.isnan(values)
    indices = np.maximum.accumulate(np.where(known, np.arange(len(values)), -1))
    return np.where(indices >= 0, values[np.maximum(indices, 0)], np.nan)


def _by_column(
    part: RowBlock, name: str, assigned: Sequence[Assigned], headings: Mapping[str, int]
) -> RowBlock:
    """Label each stretch of a constant value of a column by that value; the labels of `part` are texts."""
    import numpy as np

    known = (item for item in assigned if item.unit is not None and name in (item.name, item.heading.name))
    column = next(known, None)
    index = column.index if column is not None else None
    if index is None:
        if part.labels is None:
            raise unknown_name("column to split by", name, headings)
        values: NDArray[np.float64] = part.labels.codes.astype(np.float64)
    else:
        values = _held(part.columns[index])
    file = f"{part.labels.texts[0]} " if part.labels is not None and part.labels.named else ""
    changes = np.zeros(len(values), dtype=bool)
    changes[1:] = ~((values[1:] == values[:-1]) | (np.isnan(values[1:]) & np.isnan(values[:-1])))
    edges = [0, *np.flatnonzero(changes).tolist(), len(values)]
    codes = np.zeros(len(values), dtype=np.int64)
    texts: list[str] = []
    used: dict[str, int] = {}
    for start, stop in pairwise(edges):
        if index is None and part.labels is not None:
            text = part.labels.texts[int(part.labels.codes[start])].strip()
        else:
            text = "" if np.isnan(values[start]) else f"{file}{name}={values[start]:.6g}"
        used[text] = used.get(text, 0) + 1
        codes[start:stop] = len(texts)
        texts.append(f"{text} ({used[text]})" if text and used[text] > 1 else text)
    return replace(part, labels=Labels(codes, tuple(texts)))
