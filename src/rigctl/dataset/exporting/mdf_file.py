"""ASAM MDF 4: a channel group for each record, time as its master, the unit of every channel."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

from rigctl.dataset.exporting.tables import pieces
from rigctl.dataset.importing.formats.groups import missing_extra
from rigctl.errors import RigctlError

if TYPE_CHECKING:
    import pyarrow as pa


def write(path: Path, table: pa.Table, names: Sequence[str], title: str) -> None:
    """Write the table.

    Raises
    ------
    RigctlError
        asammdf is not installed, or the table has no time.
    """
    if title != "samples":
        raise RigctlError(
            "an MDF file holds samples", value=title, hint="Write other tables as .csv, .parquet or .mat"
        )
    try:
        from asammdf import MDF, Signal
    except ImportError as problem:
        raise missing_extra("mdf", "asammdf", path) from problem

    started = (table.schema.metadata or {}).get(b"started")
    with path.open("wb") as file, MDF(version="4.10") as mdf:
        if started is not None:  # the default is the time of writing
            mdf.header.start_time = datetime.fromisoformat(started.decode("utf-8"))
        for piece in pieces(table, names, title):
            times = {column.name: column.values for column in piece.columns}["time"]
            signals = [
                Signal(column.values, times, name=column.name, unit=column.unit)
                for column in piece.columns
                if column.name != "time"
            ]
            mdf.append(signals, acq_name=piece.name, comment=piece.name, common_timebase=True)
        mdf.save(file)
