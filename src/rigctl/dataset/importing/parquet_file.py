"""Parquet with columns named ``name [unit]``, or named plainly with the unit in the field's metadata."""

from __future__ import annotations

from pathlib import Path

from rigctl.dataset.importing.table import Heading, RawTable
from rigctl.dataset.parquet import open_parquet
from rigctl.errors import Location, RigctlError


def read_parquet(path: Path) -> RawTable:
    """Read a Parquet file; line n is its n-th row.

    Raises
    ------
    RigctlError
        the file is missing or damaged, or a column holds no numbers.
    """
    import numpy as np
    import pyarrow as pa

    where = Location(path)
    with open_parquet(path) as file:
        table = file.read()
    headings, columns = [], []
    for field, column in zip(table.schema, table.columns, strict=True):
        name, bracket, rest = field.name.partition("[")
        stored = (field.metadata or {}).get(b"unit")
        unit = rest.partition("]")[0].strip() if bracket else stored.decode("utf-8") if stored else None
        headings.append(Heading(name.strip(), unit, where))
        try:
            columns.append(column.cast(pa.float64()).to_numpy())
        except pa.ArrowException as problem:
            raise RigctlError(
                f"{field.name}: the column holds no numbers", value=str(field.type), where=where
            ) from problem
    lines = np.arange(1, len(table) + 1, dtype=np.int64)
    return RawTable(path, tuple(headings), tuple(columns), lines)
