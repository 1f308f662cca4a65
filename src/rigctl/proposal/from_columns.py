"""What a draft takes from a table's columns: inputs, initial values, ranges, outputs with their sensors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rigctl.errors import RigctlError
from rigctl.proposal.columns import Column, Floats, Table
from rigctl.proposal.draft import Formula, amount
from rigctl.units import parse_unit


def chosen(table: Table, role: str) -> list[Column]:
    """The columns of a role."""
    return [column for column in table.columns if column.role == role]


def need(table: Table, role: str, units: Sequence[str], what: str) -> Column:
    """The column of `role` whose unit fits one of `units`, in their order.

    Raises
    ------
    RigctlError
        there is none.
    """
    column = maybe(table, role, units)
    if column is not None:
        return column
    columns = ", ".join(f"{c.name} [{c.unit}]" for c in chosen(table, role)) or "none"
    raise RigctlError(
        f"the template needs {what} as an {role}",
        value=columns,
        expected=f"a column in a unit like {units[0]}",
        hint=f"--{role} NAME says which column is an {role}, --unit NAME=UNIT what it is in",
    )


def maybe(table: Table, role: str, units: Sequence[str]) -> Column | None:
    """As `need`, or None."""
    for unit in units:
        dimension = parse_unit(unit).dimension
        for column in chosen(table, role):
            if column.display.dimension == dimension:
                return column
    return None


def held(columns: Sequence[Column]) -> list[tuple[Floats, bool]]:
    """The columns' values for `rates`."""
    return [(column.values, column.stepped) for column in columns]


def given(columns: Sequence[Column]) -> dict[str, tuple[str, str]]:
    """The family's inputs, each with its default value."""
    return {c.name: (amount(_usual(c), c.unit), c.reason or "given from outside") for c in columns}


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


def sensors(columns: Sequence[Column]) -> dict[str, tuple[str, str, str]]:
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
