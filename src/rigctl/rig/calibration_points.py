"""The points of a calibration as a small table: a reference value and a raw reading in each row."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from rigctl.errors import Location, RigctlError
from rigctl.files.unit_table import UnitTable, number
from rigctl.rig.calibration_fit import Point
from rigctl.rig.channel import Channel


def read_points(path: Path, channel: Channel) -> list[Point]:
    """Return the points of a CSV file with the columns ``reference [unit]`` and ``raw``.

    Consecutive rows with the same reference are readings of one point. The unit may be omitted.

    Raises
    ------
    RigctlError
        the file cannot be read, a column is missing, a unit has the wrong dimension, or a row has no number.
    """
    table = UnitTable.read(path, f"reference [{channel.unit}],raw")
    if not table.head:
        raise RigctlError("the file is empty", expected="'reference [bar],raw'", where=Location(path))
    reference, unit = table.column("reference", channel.unit, unstated=channel.unit)
    raw = table.index("raw")
    points: list[Point] = []
    for where, row in table.rows():
        value = unit.to_si(number(row, reference, where), difference=channel.difference)
        shown = channel.display.from_si(value, difference=channel.difference)
        reading = number(row, raw, where)
        if points and math.isclose(points[-1].reference, shown, rel_tol=1e-12, abs_tol=1e-12):
            points[-1] = Point(points[-1].reference, (*points[-1].raw, reading))
        else:
            points.append(Point(shown, (reading,)))
    return points


def write_points(points: Sequence[Point], channel: Channel) -> str:
    """Return the calibration points as CSV, one row for each reading."""
    lines = [f"reference [{channel.unit}],raw [{channel.raw_unit}]"]
    lines += [f"{point.reference!r},{reading!r}" for point in points for reading in point.raw]
    return "\n".join(lines) + "\n"
