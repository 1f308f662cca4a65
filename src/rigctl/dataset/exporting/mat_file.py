"""MATLAB's MAT, version 7: a structure for each record in an array ``data``, units in ``units``."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rigctl.dataset.exporting.tables import pieces

if TYPE_CHECKING:
    import pyarrow as pa


def write(path: Path, table: pa.Table, names: Sequence[str], title: str) -> None:
    """Write the table; numbers as column vectors, texts as cells."""
    import numpy as np
    from scipy.io import savemat

    parts = list(pieces(table, names, title))
    named = ["name"] if title == "samples" else []
    fields = [*named, *dict.fromkeys(_field(column.name) for piece in parts for column in piece.columns)]
    data = np.empty(len(parts), dtype=[(field, object) for field in fields])
    units: dict[str, str] = {}
    for index, piece in enumerate(parts):
        for field in fields:
            data[index][field] = np.zeros((0, 0))
        if named:
            data[index]["name"] = piece.name
        for column in piece.columns:
            data[index][_field(column.name)] = column.values.reshape(-1, 1)
            if column.unit:
                units[_field(column.name)] = column.unit
    content = {"data": data, "units": units}
    savemat(str(path), content, appendmat=False, long_field_names=True, do_compression=True)


def _field(name: str) -> str:
    """Return a name that is valid as a MATLAB field."""
    plain = re.sub(r"\W", "_", name, flags=re.ASCII)[:63]
    return plain if plain[:1].isalpha() else f"x{plain}"[:63]
