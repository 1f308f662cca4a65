"""How the measures of a run's records are printed: over the two variables of a sweep, or a row a record."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from rich.markup import escape

from rigctl.cli.tables import console, table
from rigctl.units import significant

if TYPE_CHECKING:
    import pyarrow as pa
    from rich.console import Console
    from rich.table import Table

    from rigctl.dataset import Run

#: digits of a value
_DIGITS = 4
#: most rows, and most columns of a sweep
_ROWS, _COLUMNS = 24, 12


def show_measures(run: Run, to: Console | None = None) -> None:
    """Print every measure of every complete record; nothing if no record has one."""
    grid = measures_table(run)
    if grid is not None:
        (to or console()).print(grid)


def measures_table(run: Run) -> Table | None:
    """The measures of the complete records; None if there are none."""
    records = run.table("records")
    rows = [row for row in records.to_pylist() if row["outcome"] == "complete"]
    sweeps, measures = _named(records.schema, "sweep"), _named(records.schema, "measure")
    measures = {name: head for name, head in measures.items() if any(row[name] is not None for row in rows)}
    if not measures:
        return None
    if len(measures) == 1 and len(sweeps) == 2:
        crossed = _crossed(rows, sweeps, measures)
        if crossed is not None:
            return crossed
    grid = table("record", *map(escape, (*sweeps.values(), *measures.values())))
    for column in grid.columns:
        column.justify = "right"
    digits = {name: _decimals([row[name] for row in rows]) for name in measures}
    for row in rows[:_ROWS]:
        values = (_cell(row[name], digits.get(name)) for name in (*sweeps, *measures))
        grid.add_row(str(row["record"] + 1), *values)
    if len(rows) > _ROWS:
        grid.caption = f"and {len(rows) - _ROWS} more records"
    return grid


def _crossed(
    rows: Sequence[dict[str, Any]], sweeps: dict[str, str], measures: dict[str, str]
) -> Table | None:
    """One measure over two variables; None if a point was recorded twice, or the table would be too large."""
    (down, across), (measure,) = sweeps, measures
    cells = {(row[down], row[across]): row[measure] for row in rows}
    lines, heads = sorted({at for at, _ in cells}), sorted({at for _, at in cells})
    if len(cells) < len(rows) or len(lines) > _ROWS or not 1 < len(heads) <= _COLUMNS:
        return None
    digits = _decimals(list(cells.values()))
    unit = sweeps[across].removeprefix(across).strip(" []")
    grid = table(escape(sweeps[down]), *(escape(f"{_cell(at)} {unit}".strip()) for at in heads))
    grid.title = escape(f"{measures[measure]} over {across}")
    for column in grid.columns:
        column.justify = "right"
    for line in lines:
        grid.add_row(_cell(line), *(_cell(cells.get((line, at)), digits) for at in heads))
    return grid


def _named(schema: pa.Schema, kind: str) -> dict[str, str]:
    """The columns of a kind, with their units: ``stroke [mm]``."""
    units = {
        field.name: (field.metadata or {}).get(b"unit", b"").decode()
        for field in schema
        if (field.metadata or {}).get(b"kind") == kind.encode()
    }
    return {name: f"{name} [{unit}]" if unit not in ("", "1") else name for name, unit in units.items()}


def _decimals(values: Sequence[float | str | None]) -> int:
    """The digits behind the point with which the largest value has `_DIGITS` in all."""
    largest = max((abs(one) for one in values if isinstance(one, int | float)), default=0.0)
    whole = math.floor(math.log10(largest)) + 1 if 0.0 < largest < math.inf else 1
    return max(_DIGITS - whole, 0)


def _cell(value: float | str | None, decimals: int | None = None) -> str:
    if value is None:
        return ""
    if isinstance(value, str):
        return escape(value)
    return significant(value, _DIGITS) if decimals is None else f"{value:.{decimals}f}"
