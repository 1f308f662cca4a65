"""The measures of a run's records: over the two variables of a sweep, or a row a record."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from rigctl.answers.blocks import Block, Column, Note, Table
from rigctl.units import significant

if TYPE_CHECKING:
    import pyarrow as pa

    from rigctl.dataset import Run

#: digits of a value
_DIGITS = 4
#: most rows, and most columns of a sweep
_ROWS, _COLUMNS = 24, 12


def measure_blocks(run: Run) -> list[Block]:
    """The measures of the complete records; none if no record has one."""
    records = run.table("records")
    rows = [row for row in records.to_pylist() if row["outcome"] == "complete"]
    sweeps, measures = _named(records.schema, "sweep"), _named(records.schema, "measure")
    measures = {name: head for name, head in measures.items() if any(row[name] is not None for row in rows)}
    if not measures:
        return []
    if len(measures) == 1 and len(sweeps) == 2:
        crossed = _crossed(rows, sweeps, measures)
        if crossed is not None:
            return [crossed]
    columns = (
        Column("record", "record", lambda number: str(number + 1)),
        *(Column(name, head, _text) for name, head in sweeps.items()),
        *(Column(name, head, _rounded(row[name] for row in rows)) for name, head in measures.items()),
    )
    more = len(rows) - _ROWS
    return [Table(columns, tuple(rows[:_ROWS])), *([Note(f"and {more} more records")] if more > 0 else [])]


def _crossed(
    rows: Sequence[Mapping[str, Any]], sweeps: Mapping[str, str], measures: Mapping[str, str]
) -> Table | None:
    """One measure over two variables; None if a point was recorded twice, or the table would be too large."""
    (down, across), (measure,) = sweeps, measures
    cells = {(row[down], row[across]): row[measure] for row in rows}
    lines, heads = sorted({at for at, _ in cells}), sorted({at for _, at in cells})
    if len(cells) < len(rows) or len(lines) > _ROWS or not 1 < len(heads) <= _COLUMNS:
        return None
    form = _rounded(cells.values())
    unit = sweeps[across].removeprefix(across).strip(" []")
    columns = (
        Column("", sweeps[down], _text),
        *(Column(str(at), f"{_text(at)} {unit}".strip(), form) for at in heads),
    )
    table = tuple({"": line, **{str(at): cells.get((line, at)) for at in heads}} for line in lines)
    return Table(columns, table, f"{measures[measure]} over {across}")


def _named(schema: pa.Schema, kind: str) -> dict[str, str]:
    """The columns of a kind, with their units: ``stroke [mm]``."""
    units = {
        field.name: (field.metadata or {}).get(b"unit", b"").decode()
        for field in schema
        if (field.metadata or {}).get(b"kind") == kind.encode()
    }
    return {name: f"{name} [{unit}]" if unit not in ("", "1") else name for name, unit in units.items()}


def _text(value: float | str) -> str:
    return value if isinstance(value, str) else significant(value, _DIGITS)


def _rounded(values: Iterable[float | str | None]) -> Callable[[float | str], str]:
    """A form with as many digits behind the point as give the largest value `_DIGITS` in all."""
    largest = max((abs(one) for one in values if isinstance(one, int | float)), default=0.0)
    whole = math.floor(math.log10(largest)) + 1 if 0.0 < largest < math.inf else 1
    decimals = max(_DIGITS - whole, 0)
    return lambda value: value if isinstance(value, str) else f"{value:.{decimals}f}"
