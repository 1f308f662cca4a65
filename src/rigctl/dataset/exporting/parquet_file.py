"""Parquet with columns named ``name [unit]``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rigctl.dataset.exporting.tables import headed

if TYPE_CHECKING:
    import pyarrow as pa


def write(path: Path, table: pa.Table, names: Sequence[str], title: str) -> None:
    """Write the table."""
    import pyarrow.parquet as pq

    pq.write_table(headed(table), path, compression="zstd")
