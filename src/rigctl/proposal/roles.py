"""Which columns are inputs and which outputs, and whether an input is commanded or measured.

In: a `Table` and what the user says of its columns. Out: the table with a role and an origin for each, and
the reason for it. The user's options come first; then steps, names, a broad spectrum, and which column leads
the others.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Final

import numpy as np

from rigctl.command_line import quoted
from rigctl.dataset.importing.cells.headings import counts_rows
from rigctl.errors import RigctlError
from rigctl.proposal.columns import Column, Floats, Origin, Role, Table, rises_evenly
from rigctl.proposal.responses import driven_mass_response

#: a command stays the same over at least this share of its samples
_HELD: Final = 0.9
#: most levels of a command, relative to its length
_LEVELS: Final = 0.1
#: most levels of a command that switches too often to be held
_FEW: Final = 12
#: fewest values of an output that a model can be fitted to
_FEWEST_VALUES: Final = 3
#: words in the name of a measured quantity that is imposed from outside
_SURROUNDINGS: Final = ("ambient", "room", "outside")
_OUTSIDE: Final = ("supply", "disturbance", "load")
_COMMANDS: Final = ("setpoint", "set_point", "command", "demand", "duty", "pwm", "reference")
#: prefixes in German logs: in the middle of a word they mean something else (Brennraum)
_SURROUNDINGS_AT_FIRST: Final = ("umgebung", "raumtemp", "aussen")
_COMMANDS_AT_FIRST: Final = ("soll", "stell")
#: a lead must explain this much more than the next best
_CLEAR: Final = 1.5
_MOST_LAG: Final = 200
#: a broad spectrum: correlation with its own past, from the third sample on
_UNRELATED: Final = 0.2
_PAST: Final = range(3, 11)
#: share of a column's changes that those of another one explain, of columns that drive each other
_RELATED: Final = 0.3
_REACH: Final = 20
#: share of a position that a push leaves unexplained, if it is its push
_MOVED: Final = 0.1


@dataclass(frozen=True)
class StatedRoles:
    """What the user says of columns, or an FMU; an input neither commanded nor measured may be either.

    `reasons`, by the bench's names, say why; by default the user does.
    """

    inputs: Collection[str] = ()
    outputs: Collection[str] = ()
    omitted: Collection[str] = ()
    commanded: Collection[str] = ()
    measured: Collection[str] = ()
    reasons: Mapping[str, str] = field(default_factory=dict)

    def by_column(self, table: Table) -> tuple[dict[str, Role], dict[str, Origin]]:
        """The roles and origins by the bench's names.

        Raises
        ------
        RigctlError
            a name is unknown, or a column has two roles.
        """
        roles, origins = dict[str, Role](), dict[str, Origin]()
        stated: Sequence[tuple[Collection[str], Role, Origin | None]] = (
            (self.inputs, "input", None),
            (self.commanded, "input", "commanded"),
            (self.measured, "input", "measured"),
            (self.outputs, "output", None),
            (self.omitted, "left out", None),
        )
        for names, role, origin in stated:
            for name in (table.column(one).name for one in names):
                if roles.setdefault(name, role) != role or origins.get(name, origin) != origin:
                    raise RigctlError(
                        "the options contradict each other",
                        value=name,
                        expected="one of --input, --output and --leave; of --commanded and --measured",
                    )
                if origin is not None:
                    origins[name] = origin
        return roles, origins


def with_roles(table: Table, stated: StatedRoles) -> Table:
    """The table with a role for every column, and for every input its origin.

    A column is an input if it is constant except for steps, like a command, if its name says that it is
    imposed from outside, or, if there is no such column, if its spectrum is as broad as only a command's is,
    or its changes precede those of all others.

    Raises
    ------
    RigctlError
        a name is unknown; no column is an input although columns are related; an output repeats an input; or
        nothing is left to explain.
    """
    # The surest evidence first: the user, then the form of a command (steps), then names. Only if none of
    # these finds an input is one inferred from the course of the columns, a broad spectrum or a lead. If that
    # is not clear, there is no input: a wrong one would spoil every later verdict, and a missing one is
    # noticed at once.
    roles, origins = stated.by_column(table)
    if table.times is None:
        _refuse_unstated_times(table, roles)
    columns = [_judged(column, table, roles.get(column.name), stated.reasons) for column in table.columns]
    if table.times is not None and not any(column.role == "input" for column in columns):
        columns = _by_spectrum(columns, table, roles) or _by_lead(columns, table, roles)
    if not any(column.role == "output" for column in columns) and len(columns) > 1 and not stated.outputs:
        columns = _with_last_output(columns, roles)
    # Then what must hold for any model to be fitted: something drives, something changes, and nothing
    # explains itself.
    columns = [_with_origin(column, table, origins.get(column.name)) for column in columns]
    _require_input(columns, table, roles)
    _require_change(columns)
    _refuse_copies(columns)
    return replace(table, columns=tuple(columns))


def _refuse_unstated_times(table: Table, roles: Mapping[str, Role]) -> None:
    """Refuse to take a column that numbers the rows, or may be their time, for a setting of a table.

    Raises
    ------
    RigctlError
        the user has not said what the column is.
    """
    for column in table.columns:
        if column.name in roles:
            continue
        counted = counts_rows(column.theirs, column.values)
        if not counted and (column.known or not rises_evenly(column.values)):
            continue
        first = ", ".join(f"{value:g}" for value in column.values[:3])
        unit = "50 ms" if counted else "s"
        case = "if there are 50 ms from row to row" if counted else "if it is the time in seconds"
        way = "--leave" if counted else "--input"
        raise RigctlError(
            f"{column.theirs}: {'it numbers the rows' if counted else 'it rises evenly'}, and no column is "
            "known to be their time",
            value=f"{first} …",
            expected=f"--unit {quoted(f'{column.theirs}={unit}')} {case}; {way} {quoted(column.theirs)} if "
            "the rows are operating points, without a time",
        )


def _judged(column: Column, table: Table, stated: Role | None, reasons: Mapping[str, str]) -> Column:
    stepped = table.times is not None and _is_stepped(column.values, table)
    if stated is not None:
        reason = reasons.get(column.name, "as you say")
        return replace(column, role=stated, reason=reason, stepped=stepped)
    if column.role == "left out":
        return column
    role, reason = _role_of(column, table, stepped=stepped)
    return replace(column, role=role, reason=reason, stepped=stepped)


def _role_of(column: Column, table: Table, *, stepped: bool) -> tuple[Role, str]:
    present = column.values[np.isfinite(column.values)]
    still = present.size > 0 and np.ptp(present) == 0.0
    outside = _is_surrounding(column.name) or _is_named_command(column.name) or _has(column.name, _OUTSIDE)
    first = table.times is None and column is table.columns[0]
    # The first rule that holds decides, and its reason is told to the user.
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


def _has(name: str, words: Sequence[str]) -> bool:
    return any(word in name for word in words)


def _is_surrounding(name: str) -> bool:
    return _has(name, _SURROUNDINGS) or name.startswith(_SURROUNDINGS_AT_FIRST)


def _is_named_command(name: str) -> bool:
    return _has(name, _COMMANDS) or name.startswith(_COMMANDS_AT_FIRST)


def _with_last_output(columns: list[Column], roles: Mapping[str, Role]) -> list[Column]:
    """Something must be explained: the last column that changes and that the user has not given a role."""
    free = [k for k, one in enumerate(columns) if one.name not in roles and one.role == "input"]
    if not free:
        return columns
    last = replace(columns[free[-1]], role="output", reason="the last column: something must be explained")
    return [last if k == free[-1] else one for k, one in enumerate(columns)]


def _is_stepped(values: Floats, table: Table) -> bool:
    changes = _changes(values, table)
    if changes.size < 4:
        return False
    held = float(np.mean(changes == 0.0))
    return held >= _HELD and _levels(values) <= max(2.0, _LEVELS * values.size)


def _changes(values: Floats, table: Table) -> Floats:
    steps = [np.diff(values[rows]) for rows in table.pieces]
    return np.concatenate(steps) if steps else np.empty(0)


def _levels(values: Floats) -> int:
    return int(np.unique(np.round(values[np.isfinite(values)], 9)).size)


def _has_few_levels(values: Floats) -> bool:
    """Whether there are few values, and few for so many readings."""
    return _levels(values) <= max(2, min(_FEW, int(_LEVELS * values.size)))


def _with_origin(column: Column, table: Table, stated: Origin | None) -> Column:
    """An input with its origin. A command with a few levels holds between samples; of one that changes from
    sample to sample, such as a multisine or a controller's output, a line is closer to what acted."""
    if column.role != "input":
        return column
    origin, why = (stated, "as you say") if stated is not None else _origin_of(column, table)
    switched = origin == "commanded" and table.times is not None and _has_few_levels(column.values)
    held = column.stepped or switched
    reason = column.reason if why in ("", column.reason) else f"{column.reason}; {why}"
    return replace(column, origin=origin, reason=reason, stepped=held)


def _origin_of(column: Column, table: Table) -> tuple[Origin, str]:
    values = column.values
    # Commanded or measured: a command has no noise and is known exactly; taken for one, a measured input
    # would put its noise into the model's error. Where nothing tells, it is `unclear`, and the files say so.
    rules: list[tuple[bool, Origin, str]] = [
        (not values.size, "commanded", ""),
        (_is_surrounding(column.name), "measured", ""),
        (column.stepped, "commanded", ""),
        (_is_named_command(column.name), "commanded", "commanded, by its name"),
        (table.times is None, "measured", ""),  # a setting of a table acts as it was read
        (_has_few_levels(values), "commanded", f"commanded: it has only {_levels(values)} values"),
        (_is_broad(values, table), "commanded", "commanded: unrelated to its own past"),
    ]
    return next(
        ((origin, why) for holds, origin, why in rules if holds),
        ("unclear", "commanded or measured? The log does not tell"),
    )


def _is_broad(values: Floats, table: Table) -> bool:
    """Whether a signal has next to nothing to do with its own past: a multisine, filtered noise."""
    rows = max(table.pieces, key=len)
    u = _normed(values[rows])
    if u.size < 4 * _PAST.stop:
        return False
    return max(abs(float(u[lag:] @ u[:-lag])) for lag in _PAST) < _UNRELATED


def _by_spectrum(columns: list[Column], table: Table, roles: Mapping[str, Role]) -> list[Column] | None:
    """With the one broad column beside others that are related to their past, if there is one."""
    free = [k for k, one in enumerate(columns) if one.role == "output" and one.name not in roles]
    broad = [k for k in free if _is_broad(columns[k].values, table)]
    others = [one for k, one in enumerate(columns) if one.role == "output" and k not in broad]
    if len(broad) != 1 or not others:
        return None
    (index,) = broad
    found = replace(columns[index], role="input", reason="its spectrum is broad, as a command's may be")
    return [found if k == index else one for k, one in enumerate(columns)]


def _by_lead(columns: list[Column], table: Table, roles: Mapping[str, Role]) -> list[Column]:
    """The one column whose changes come before those of every other, if that is clear."""
    free = [
        index for index, column in enumerate(columns) if column.role == "output" and column.name not in roles
    ]
    others_of = {
        index: [k for k, one in enumerate(columns) if one.role == "output" and k != index] for index in free
    }
    rows = max(table.pieces, key=len)
    # Differences of the columns, of unit length: u leads y if corr(Δu(t), Δy(t + lag)) is much larger than
    # the other way round.
    changes = {
        index: _normed(np.diff(column.values[rows]))
        for index, column in enumerate(columns)
        if column.role == "output"
    }
    for index in free:
        others = others_of[index]
        if others and all(_leads(changes[index], changes[other]) for other in others):
            leader = replace(
                columns[index], role="input", reason="its changes come before those of the others"
            )
            return [*columns[:index], leader, *columns[index + 1 :]]
    return columns


def _normed(values: Floats) -> Floats:
    present = values[np.isfinite(values)]
    centred = np.nan_to_num(values - (float(present.mean()) if present.size else 0.0))
    return np.asarray(centred / (float(np.linalg.norm(centred)) or 1.0))


def _leads(first: Floats, second: Floats) -> bool:
    """Whether `second` follows `first` by a sample or more, and not the other way round."""
    most = min(_MOST_LAG, first.size // 4)
    if most < 2:
        return False
    after = max(abs(float(first[:-lag] @ second[lag:])) for lag in range(1, most))
    before = max(abs(float(second[:-lag] @ first[lag:])) for lag in range(1, most))
    return after > _CLEAR * before


def _require_input(columns: Sequence[Column], table: Table, roles: Mapping[str, Role]) -> None:
    """Refuse a draft in which nothing drives anything although columns change together.

    Raises
    ------
    RigctlError
        they do, and the user has not called both of them outputs.
    """
    if table.times is None or any(column.role == "input" for column in columns):
        return
    outputs = [column for column in columns if column.role == "output"]
    for one, other in combinations(outputs, 2):
        if roles.get(one.name) == roles.get(other.name) == "output":
            continue
        if not _related(one, other, table) and not _moves(one, other, table):
            continue
        names = [column.theirs for column in outputs]
        options = " or ".join(f"--input {quoted(name)}" for name in names)
        alone = " ".join(f"--output {quoted(name)}" for name in names)
        raise RigctlError(
            f"'{one.theirs}' and '{other.theirs}' change together, but the log does not tell which of them "
            "drives the other",
            expected=f"{options}; or, if nothing drives them (released, cooling), {alone}",
        )


def _related(one: Column, other: Column, table: Table) -> bool:
    """Whether the changes of a column follow from those of the other, within some samples either way."""
    rows = max(table.pieces, key=len)
    first, second = (np.diff(column.values[rows]) for column in (one, other))
    if first.size < 4 * _REACH:
        return False
    shifts = range(-_REACH, _REACH + 1)
    # Δy regressed on Δu at lags −20 … 20: related if that explains more than its number of coefficients would
    # by chance.
    matrix = np.column_stack([np.roll(first, shift) for shift in shifts])[_REACH:-_REACH]
    target = second[_REACH:-_REACH]
    known = np.isfinite(target) & np.isfinite(matrix).all(axis=1)  # a missing value is no standstill
    if known.sum() < 2 * _REACH:
        return False
    matrix, target = matrix[known] - np.mean(matrix[known], axis=0), target[known] - np.mean(target[known])
    solution, *_ = np.linalg.lstsq(matrix, target, rcond=1e-6)
    rest = target - matrix @ solution
    chance = len(shifts) / target.size
    total = float(target @ target)
    return total > 0.0 and 1.0 - float(rest @ rest) / total > _RELATED + chance


def _moves(one: Column, other: Column, table: Table) -> bool:
    """Whether a column is the position of a mass that the other pushes: its bend follows, not its change."""
    found = [driven_mass_response(table, x, [u]) for x, u in ((one, other), (other, one))]
    return any(response is not None and response.unexplained < _MOVED for response in found)


def _require_change(columns: Sequence[Column]) -> None:
    """Refuse an output with hardly any values: nothing can be fitted to it.

    Raises
    ------
    RigctlError
        an output has fewer than three values.
    """
    for column in columns:
        if column.role == "output" and column.values.size and _levels(column.values) < _FEWEST_VALUES:
            raise RigctlError(
                f"the output '{column.theirs}' has only {_levels(column.values)} different values: no model "
                "can be fitted to it",
                hint=f"--leave {quoted(column.theirs)} leaves it out, --input {quoted(column.theirs)} makes "
                "it an input",
            )


def _refuse_copies(columns: Sequence[Column]) -> None:
    """Refuse an output that is one of its inputs, perhaps in another unit.

    Raises
    ------
    RigctlError
        one is.
    """
    for u in (column for column in columns if column.role == "input"):
        for y in (column for column in columns if column.role == "output"):
            if u.values.size == y.values.size and _is_copy(u.values, y.values):
                raise RigctlError(
                    f"the output '{y.theirs}' is the input '{u.theirs}' once more: it would explain itself",
                    hint=f"--leave {quoted(u.theirs)} or --leave {quoted(y.theirs)} leaves one of them out",
                )


def _is_copy(u: Floats, y: Floats) -> bool:
    both = np.isfinite(u) & np.isfinite(y)
    if both.sum() < 4:
        return False
    first, second = _normed(u[both]), _normed(y[both])
    return bool(np.abs(first - second).max() < 1e-6 or np.abs(first + second).max() < 1e-6)
