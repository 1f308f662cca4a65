"""The points of a calibration as a small table: a reference value and a raw reading in each row."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from pathlib import Path

from rigctl.errors import Location, RigctlError
from rigctl.files.regular import read_text
from rigctl.rig.calibration_fit import Point
from rigctl.rig.channel import Channel
from rigctl.units import Unit, parse_unit

_MOST = 100_000  # largest number of rows


def read_points(path: Path, channel: Channel) -> list[Point]:
    """Return the points of a CSV file with the columns ``reference [unit]`` and ``raw``.

    Consecutive rows with the same reference are readings of one point. The unit may be omitted.

    Raises
    ------
    RigctlError
        the file cannot be read, a column is missing, a unit has the wrong dimension, or a row has no number.
    """
    try:
        text = read_text(path, "utf-8-sig")
    except FileNotFoundError as problem:
        raise RigctlError("there is no such file", value=path.as_posix(), where=Location(path)) from problem
    except (OSError, UnicodeDecodeError) as problem:
        raise RigctlError(f"cannot read the file: {problem}", where=Location(path)) from problem
    rows = list(csv.reader(io.StringIO(text)))[: _MOST + 1]
    if not rows:
        raise RigctlError("the file is empty", expected="'reference [bar],raw'", where=Location(path))
    reference, raw, unit = _columns(rows[0], channel, path)
    points: list[Point] = []
    for number, row in enumerate(rows[1:], start=2):
        if not any(cell.strip() for cell in row):
            continue
        where = Location(path, number)
        value = unit.to_si(_number(row, reference, where), difference=channel.difference)
        shown = channel.display.from_si(value, difference=channel.difference)
        reading = _number(row, raw, where)
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


def _columns(header: Sequence[str], channel: Channel, path: Path) -> tuple[int, int, Unit]:
    names = [cell.partition("[")[0].strip().casefold() for cell in header]
    for wanted in ("reference", "raw"):
        if names.count(wanted) != 1:
            raise RigctlError(
                f"one column '{wanted}' is expected",
                value=", ".join(header),
                expected=f"'reference [{channel.unit}],raw'",
                where=Location(path, 1),
            )
    cell = header[names.index("reference")]
    written = cell.partition("[")[2].rpartition("]")[0].strip() or channel.unit
    unit = parse_unit(written)
    if unit.dimension != channel.display.dimension:
        raise RigctlError(
            "wrong dimension", value=written, expected=f"a unit like {channel.unit}", where=Location(path, 1)
        )
    return names.index("reference"), names.index("raw"), unit


def _number(row: Sequence[str], column: int, where: Location) -> float:
    cell = row[column].strip() if column < len(row) else ""
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise RigctlError("no number", value=cell, where=where)
    return value
