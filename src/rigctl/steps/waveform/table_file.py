"""The table of a waveform from a CSV file with the columns ``time [s]`` and ``NAME [unit]``."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from rigctl.errors import Location, RigctlError
from rigctl.files.unit_table import UnitTable, number


def read_table(
    path: Path, name: str, unit: str, check: Callable[[float], None]
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return the times, s, and the SI values of a file.

    Parameters
    ----------
    name, unit: the actuator whose column is read, and a unit of its dimension.
    check: raises for a value that is invalid for the actuator; the line is added to the message.

    Raises
    ------
    RigctlError
        the file cannot be read, a column or a number is missing, or a value is invalid; with the line.
    """
    table = UnitTable.read(path, f"time [s],{name} [{unit}]")
    time_column, time_unit = table.column("time", "s")
    value_column, value_unit = table.column(name, unit)
    times: list[float] = []
    values: list[float] = []
    for where, row in table.rows():
        times.append(time_unit.to_si(number(row, time_column, where)))
        values.append(value_unit.to_si(number(row, value_column, where)))
        try:
            check(values[-1])
        except RigctlError as error:
            raise error.at(where) from None
        if len(times) > 1 and times[-1] <= times[-2]:
            raise RigctlError("the time does not increase", value=row[time_column].strip(), where=where)
    if len(times) < 2:
        raise RigctlError("too few rows", expected="at least two", where=Location(path))
    return tuple(time - times[0] for time in times), tuple(values)
