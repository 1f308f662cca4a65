"""What a draft takes from a table's columns: inputs, initial values, ranges, outputs with their sensors.

In: columns with their roles. Out: the parts of a `Draft` that are alike in every template: an input with a
slot where an actuator's deviations may act, a reading with one for its sensor's, starts, scales and bounds
from the range of the data. A slot that no draft had could never be found to lack a term.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rigctl.errors import RigctlError
from rigctl.proposal.columns import Column, Floats, Table
from rigctl.proposal.draft import Formula, Input, Parameter, Slot, amount
from rigctl.units import is_angle, is_speed_of_rotation, parse_unit


def chosen(table: Table, role: str) -> list[Column]:
    """The columns of a role."""
    return [column for column in table.columns if column.role == role]


class UnfittingError(RigctlError):
    """No column has a unit that a template needs."""


def need(table: Table, role: str, units: Sequence[str], what: str) -> Column:
    """The column of `role` whose unit fits one of `units`, in their order.

    Raises
    ------
    UnfittingError
        there is none.
    """
    column = maybe(table, role, units)
    if column is not None:
        return column
    columns = ", ".join(f"{c.name} [{c.unit}]" for c in chosen(table, role)) or "none"
    raise UnfittingError(
        f"the template needs {what} as an {role}",
        value=columns,
        expected=f"a column in a unit like {units[0]}",
        hint=f"--{role} NAME says which column is an {role}, --unit NAME=UNIT what it is in",
    )


def maybe(table: Table, role: str, units: Sequence[str]) -> Column | None:
    """As `need`, or None."""
    for unit in units:
        for column in chosen(table, role):
            if _is_like(column.unit, unit):
                return column
    return None


def _is_like(unit: str, other: str) -> bool:
    """Whether two units are of one quantity: a plain number is no angle, and a count per time no speed."""
    return (
        parse_unit(unit).dimension == parse_unit(other).dimension
        and is_angle(unit) == is_angle(other)
        and is_speed_of_rotation(unit) == is_speed_of_rotation(other)
    )


def held(columns: Sequence[Column]) -> list[tuple[Floats, bool]]:
    """The columns' values for `rates`."""
    return [(column.values, column.stepped) for column in columns]


def given(columns: Sequence[Column], *, late: bool = True) -> dict[str, Input]:
    """The family's inputs, each with its default value; the switches of commands may be `late`."""
    return {
        c.name: Input(
            amount(_usual(c), c.unit),
            c.reason or "given from outside",
            f"{c.name}_delay" if late and _switches(c) else "",
            "linear" if late and c.origin == "commanded" and not c.stepped else "",
        )
        for c in columns
    }


def _switches(column: Column) -> bool:
    return column.origin == "commanded" and column.stepped


def acting(column: Column) -> str:
    """What acts in the equations: an input, with a slot for what an actuator makes of it."""
    return f"({column.name} + {column.name}_input)"


def at_inputs(columns: Sequence[Column], *, late: bool = True) -> dict[str, Slot]:
    """Slots at the inputs, where a dead band, a saturation, play or a lag of a command may act, and at the
    switches of commands, which may be late."""
    slots = dict[str, Slot]()
    for c in columns:
        slots[f"{c.name}_input"] = (c.interval, "process", f"what acts besides {c.name}")
        if late and _switches(c):
            slots[f"{c.name}_delay"] = ("s", "command", f"until {c.name} acts")
    return slots


def _usual(column: Column) -> float:
    """The value of an input at rest: zero if it is within the data's range, else the median."""
    present = column.values[np.isfinite(column.values)]
    if not present.size:
        return column.display.offset
    low, high = float(present.min()), float(present.max())
    zero = column.display.offset
    return (
        zero if low <= zero <= high and not column.display.absolute_temperature else float(np.median(present))
    )


def begin(column: Column) -> tuple[str, str]:
    """A state's start and scale as they are written: the first value, a hundredth of the range."""
    present = column.values[np.isfinite(column.values)]
    first = float(present[0]) if present.size else column.display.offset
    return amount(first, column.unit), amount(0.01 * span(column), column.interval, difference=True)


def counted(column: Column) -> str:
    """What acts of an input, as a difference: a temperature counts from a reference."""
    return (
        f"({acting(column)} - {column.name}_reference)"
        if column.display.absolute_temperature
        else acting(column)
    )


def references(inputs: Sequence[Column]) -> dict[str, tuple[str, str]]:
    """The constants from which temperatures among the inputs count."""
    return {
        f"{u.name}_reference": (f"0 {u.unit}", f"from where {u.name} counts")
        for u in inputs
        if u.display.absolute_temperature
    }


def at_rest(y: Column, value: float) -> Parameter:
    """Rest value of an output without input; wide bounds around its range."""
    present = y.shown[np.isfinite(y.shown)]
    low, high = (float(present.min()), float(present.max())) if present.size else (-100.0, 100.0)
    room = max(high - low, 1e-9)
    at = y.display.from_si(value)
    low, high = low - 5.0 * room, high + 5.0 * room
    if y.display.absolute_temperature:
        low = max(low, y.display.from_si(0.0))
    return Parameter(min(max(at, low), high), y.unit, low, high, f"where {y.name} rests without any input")


def unknown_start(value: str, spread: float, unit: str) -> str:
    """The start of a state that no channel shows: an unknown of each record."""
    return f"{{value: {value}, std: {amount(spread, unit, difference=True)}}}"


def span(column: Column) -> float:
    """The range of a column, SI; one of its unit without data."""
    present = column.values[np.isfinite(column.values)]
    width = float(np.ptp(present)) if present.size else 0.0
    return width or column.display.factor


def duration(table: Table) -> float:
    """Duration of the longest record, s."""
    if table.times is None or not table.times.size:
        return 100.0
    return max((float(np.ptp(table.times[rows])) for rows in table.pieces), default=100.0) or 100.0


def reading(column: Column, what: str = "") -> Formula:
    """An output that shows the state or definition of its name, with a slot for the sensor."""
    return Formula(column.unit, f"{column.name} + {column.name}_reading", what or "as it was measured")


def sensors(columns: Sequence[Column]) -> dict[str, Slot]:
    """A slot for what each sensor shows beside the truth."""
    return {f"{c.name}_reading": (c.interval, "sensor", f"of {c.name} beside the truth") for c in columns}


def require_outputs(table: Table) -> list[Column]:
    """The outputs, of which there must be one.

    Raises
    ------
    RigctlError
        no column is an output.
    """
    outputs = chosen(table, "output")
    if not outputs:
        raise RigctlError(
            "no column is an output: nothing is to be explained", hint="--output NAME says which is"
        )
    return outputs
