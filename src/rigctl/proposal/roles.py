"""Which columns are inputs and which are outputs: by the user's options, by their steps, and by which
leads."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from typing import Final

import numpy as np

from rigctl.proposal.columns import Column, Floats, Role, Table

#: a command stays the same over at least this share of its samples
_HELD: Final = 0.9
#: most levels of a command, relative to its length
_LEVELS: Final = 0.1
#: words in the name of a measured quantity that is imposed from outside
_OUTSIDE: Final = ("ambient", "room", "outside", "setpoint", "command", "supply", "disturbance", "load")
#: prefixes in German logs: in the middle of a word they mean something else (Brennraum)
_OUTSIDE_AT_FIRST: Final = ("umgebung", "raumtemp", "aussen", "soll")
#: a lead must explain this much more than the next best
_CLEAR: Final = 1.5
_MOST_LAG: Final = 200


def with_roles(
    table: Table, inputs: Collection[str], outputs: Collection[str], omitted: Collection[str]
) -> Table:
    """The table with a role for every column; the user's options have precedence.

    A column is an input if it is constant except for steps, like a command, if its name says that it is
    imposed from outside, or, if there is no such column, if its changes precede those of all others.

    Raises
    ------
    RigctlError
        a name is unknown.
    """
    stated = {table.column(name).name: "input" for name in inputs}
    stated |= {table.column(name).name: "output" for name in outputs}
    stated |= {table.column(name).name: "left out" for name in omitted}
    columns = [_judged(column, table, stated.get(column.name)) for column in table.columns]
    if table.times is not None and not any(column.role == "input" for column in columns):
        columns = _by_lead(columns, table, stated)
    if not any(column.role == "output" for column in columns) and len(columns) > 1 and not outputs:
        columns[-1] = replace(
            columns[-1], role="output", reason="the last column: something must be explained"
        )
    return replace(table, columns=tuple(columns))


def _judged(column: Column, table: Table, stated: str | None) -> Column:
    stepped = table.times is not None and _is_stepped(column.values, table)
    if stated is not None:
        return replace(column, role=stated, reason="as you say", stepped=stepped)  # type: ignore[arg-type]
    role, reason = _role_of(column, table, stepped=stepped)
    return replace(column, role=role, reason=reason, stepped=stepped)


def _role_of(column: Column, table: Table, *, stepped: bool) -> tuple[Role, str]:
    present = column.values[np.isfinite(column.values)]
    still = present.size > 0 and np.ptp(present) == 0.0
    outside = any(word in column.name for word in _OUTSIDE) or column.name.startswith(_OUTSIDE_AT_FIRST)
    first = table.times is None and column is table.columns[0]
    rules: list[tuple[bool, Role, str]] = [
        (not present.size, "left out", "no value in it"),
        (stepped and not still, "input", "constant but for steps, as a command is"),
        (outside, "input", "its name says that it is given from outside"),
        (still, "left out", "it never changes"),
        (first, "input", "the first column of a table"),
    ]
    return next(
        ((role, reason) for holds, role, reason in rules if holds),
        ("output", "it changes from sample to sample"),
    )


def _is_stepped(values: Floats, table: Table) -> bool:
    steps = [np.diff(values[rows]) for rows in table.pieces]
    changes = np.concatenate(steps) if steps else np.empty(0)
    if changes.size < 4:
        return False
    levels = np.unique(np.round(values[np.isfinite(values)], 9)).size
    held = float(np.mean(changes == 0.0))
    return held >= _HELD and levels <= max(2.0, _LEVELS * values.size)


def _by_lead(columns: list[Column], table: Table, stated: dict[str, str]) -> list[Column]:
    """The one column whose changes come before those of every other, if that is clear."""
    free = [
        index for index, column in enumerate(columns) if column.role == "output" and column.name not in stated
    ]
    if len(free) < 2:
        return columns
    rows = max(table.pieces, key=len)
    changes = {index: _normed(np.diff(columns[index].values[rows])) for index in free}
    for index in free:
        others = [other for other in free if other != index]
        if all(_leads(changes[index], changes[other]) for other in others):
            leader = replace(
                columns[index], role="input", reason="its changes come before those of the others"
            )
            return [*columns[:index], leader, *columns[index + 1 :]]
    return columns


def _normed(changes: Floats) -> Floats:
    changes = np.nan_to_num(changes - np.nanmean(changes))
    return changes / (float(np.linalg.norm(changes)) or 1.0)


def _leads(first: Floats, second: Floats) -> bool:
    """Whether `second` follows `first` by a sample or more, and not the other way round."""
    most = min(_MOST_LAG, first.size // 4)
    if most < 2:
        return False
    after = max(abs(float(first[:-lag] @ second[lag:])) for lag in range(1, most))
    before = max(abs(float(second[:-lag] @ first[lag:])) for lag in range(1, most))
    return after > _CLEAR * before
