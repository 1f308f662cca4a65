"""The index row of one run, from its ``run.json`` and the footer of its ``samples.parquet``."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from rigctl.dataset import run_json
from rigctl.dataset.annotations import Annotation, excluded_records
from rigctl.dataset.parquet import open_parquet
from rigctl.dataset.recording import samples_file
from rigctl.dataset.run_fields import column_values
from rigctl.dataset.run_order import is_run, order_of
from rigctl.dataset.run_status import status_of
from rigctl.dataset.storage.store import StorageSilent, StoredFolder
from rigctl.errors import RigctlError

#: states in which a run may still change by itself
OPEN = (run_json.RUNNING, "unclosed")
DAMAGED = "damaged"


class FileState(NamedTuple):
    """The version of a ``run.json``: size and modification time; −1 if there is none."""

    size: int
    mtime: int


class ChannelRange(NamedTuple):
    """The range of a column of a run's samples, in display units; None if all values are NaN."""

    name: str
    unit: str
    kind: str
    low: float | None
    high: float | None


class Row(NamedTuple):
    """One run: the values of `schema.RUN_COLUMNS` and `schema.INNER_COLUMNS`, and its columns' ranges."""

    values: dict[str, Any]
    channels: tuple[ChannelRange, ...]


def file_state(folder: Path | str) -> FileState | None:
    """Return the version of a run's ``run.json``; None for a folder that is not a run."""
    try:
        facts = os.stat(f"{folder}{os.sep}{run_json.NAME}")  # noqa: PTH116 - Path objects take twice as long
    except OSError:
        # a damaged run may lack one of run.json and its log
        return FileState(-1, 0) if is_run(Path(folder)) else None
    return FileState(facts.st_size, facts.st_mtime_ns)


def read_row(folder: Path, shard: str, state: FileState, *, channels: bool = True) -> Row:
    """Return a run's row; an unreadable run is marked as damaged."""
    values: dict[str, Any] = {"shard": shard, **state._asdict()}
    try:
        info = run_json.read_info(folder)
        values |= facts_of(info) | {"status": status_of(folder, info)}
    except RigctlError:
        info, values["status"] = {}, DAMAGED
    values |= {"id": folder.name, "open": values["status"] in OPEN}
    values |= order_of(folder, info)._asdict()
    closed = channels and not values["open"] and bool(info)
    return Row(values, ranges_of(folder, info) if closed else ())


def stored_row(folder: StoredFolder, info: Mapping[str, Any] | None, state: tuple[int, str]) -> Row:
    """Return the row of a run in storage from its ``run.json``; None if that is damaged.

    `state` is the size of ``run.json`` there, and the storage's version mark.
    """
    size, tag = state
    values: dict[str, Any] = {"status": DAMAGED, "began": ""}
    if info is not None:
        values = facts_of(info) | {"began": str(info.get("started", ""))}
    values |= {"id": folder.name, "shard": "", "open": False, "number": 1}
    return Row(values | {"size": size, "mtime": tag, "second": folder.name[:15]}, ())


def facts_of(info: Mapping[str, Any]) -> dict[str, Any]:
    """Return the index columns of a run from its ``run.json``."""
    annotations = [Annotation(**statement) for statement in info.get("annotations", ())]
    return {
        **column_values(info),
        "started_as": info["started"],
        "notes": sum(statement.kind == "note" for statement in annotations),
        "excluded": len(excluded_records(annotations)),
    }


def ranges_of(folder: Path | StoredFolder, info: Mapping[str, Any]) -> tuple[ChannelRange, ...]:
    """Return the ranges of the columns from Parquet's block statistics; empty if the file is damaged.

    Raises
    ------
    StorageSilent
        the file is in a storage that does not respond.
    """
    try:
        return _read_ranges(folder, info)
    except StorageSilent:
        raise
    except RigctlError:
        return ()


def _read_ranges(folder: Path | StoredFolder, info: Mapping[str, Any]) -> tuple[ChannelRange, ...]:
    layout = info["layout"]
    units = dict(
        zip(("time", "record", *layout["channels"], *layout["commands"]), layout["units"], strict=False)
    )
    channels = set(layout["channels"])
    ranges = []
    with open_parquet(folder / samples_file.NAME) as file:
        about = file.metadata
        groups = [about.row_group(number) for number in range(about.num_row_groups)]
        for index, name in enumerate(about.schema.names):
            if name == "record":
                continue
            lows, highs = [], []
            for group in groups:
                facts = group.column(index).statistics
                if facts is not None and facts.has_min_max and isinstance(facts.min, int | float):
                    lows.append(float(facts.min))
                    highs.append(float(facts.max))
            kind = "time" if name == "time" else "channel" if name in channels else "command"
            low, high = min(lows, default=None), max(highs, default=None)
            ranges.append(ChannelRange(name, str(units.get(name, "")), kind, low, high))
    return tuple(ranges)
