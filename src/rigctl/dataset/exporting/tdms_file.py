"""LabVIEW's TDMS: a group for each record, the unit in the property ``unit_string`` of a channel."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rigctl.dataset.exporting.tables import pieces
from rigctl.dataset.importing.formats.groups import missing_extra

if TYPE_CHECKING:
    import pyarrow as pa


def write(path: Path, table: pa.Table, names: Sequence[str], title: str) -> None:
    """Write the table.

    Raises
    ------
    RigctlError
        npTDMS is not installed.
    """
    try:
        from nptdms import ChannelObject, TdmsWriter
    except ImportError as problem:
        raise missing_extra("tdms", "npTDMS", path) from problem

    with path.open("wb") as file, TdmsWriter(file) as writer:
        for piece in pieces(table, names, title):
            channels = []
            for column in piece.columns:
                values = column.values.tolist() if column.values.dtype == object else column.values
                facts = {"unit_string": column.unit} if column.unit else {}
                channels.append(ChannelObject(piece.name, column.name, values, facts))
            writer.write_segment(channels)
