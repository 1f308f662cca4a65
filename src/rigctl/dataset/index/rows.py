"""One run as the index has it, read from its ``run.json`` and the end of its ``samples.parquet``."""

from __future__ import annotations

import os
from collections.abc import Mapping
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

from rigctl.dataset import log, run_json, samples_file
from rigctl.dataset.annotations import Annotation, excluded_records
from rigctl.dataset.parquet import open_parquet
from rigctl.dataset.run_order import order_of
from rigctl.dataset.run_status import status_of
from rigctl.dataset.storage.store import Store, StoredFolder
from rigctl.errors import RigctlError

#: the states in which a run may still change by itself
OPEN = (run_json.RUNNING, "unclosed")
DAMAGED = "damaged"


class FileState(NamedTuple):
    """What tells one ``run.json`` from the one before it: size and time of change; −1 where there is none."""

    size: int
    mtime: int


class ChannelRange(NamedTuple):
    """What a column of a run's samples ranges over, in display units; None where it has no value but NaN."""

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
    """The state of a run's ``run.json``; None for a folder that is no run."""
    try:
        facts = os.stat(f"{folder}{os.sep}{run_json.NAME}")  # noqa: PTH116 - a Path for each takes twice as long
    except OSError:
        # a run has lost run.json or its log at worst
        return FileState(-1, 0) if Path(folder, log.NAME).is_file() else None
    return FileState(facts.st_size, facts.st_mtime_ns)


def read_row(folder: Path, shard: str, state: FileState, *, channels: bool = True) -> Row:
    """A run's row; of one that cannot be read that it is damaged."""
    values: dict[str, Any] = {"id": folder.name, "shard": shard, **state._asdict(), "open": False}
    try:
        info = run_json.read_info(folder)
        status = status_of(folder, info)
        values |= facts_of(info) | {"status": status, "open": status in OPEN}
    except (RigctlError, KeyError, TypeError, AttributeError):
        info, values["status"] = {}, DAMAGED
    values |= order_of(folder, info)._asdict()
    closed = channels and not values["open"] and bool(info)
    return Row(values, _ranges(folder, info) if closed else ())


def stored_rows(store: Store, infos: Mapping[str, Mapping[str, Any] | None], *, channels: bool) -> list[Row]:
    """The rows of runs in storage, by what their ``run.json`` says; None where that is damaged."""
    rows = []
    for run_id, info in infos.items():
        values: dict[str, Any] = {"id": run_id, "shard": "", "open": False, "number": 1}
        began = "" if info is None else str(info.get("started", ""))
        values |= {
            "second": run_id[:15],
            "began": began,
            "status": DAMAGED if info is None else info["status"],
        }
        if info is not None:
            values |= facts_of(info)
        wanted = channels and info is not None
        rows.append(Row(values, _ranges(store.folder(run_id), info or {}) if wanted else ()))
    return rows


def facts_of(info: Mapping[str, Any]) -> dict[str, Any]:
    """What a ``run.json`` says of a run, its status apart, as the index has it."""
    said = [Annotation(**statement) for statement in info.get("annotations", ())]
    same = ("source", "operator", "seed", "duration", "records", "complete_records", "rows")
    return {
        **{name: info.get(name) for name in same},
        "procedure": info["procedure"]["name"],
        "rig": info["rig"]["name"],
        "backend": info.get("backend", {}).get("kind"),
        "started": _utc(info["started"]),
        "started_as": info["started"],
        "ended": _utc(info.get("ended")),
        "notes": sum(statement.kind == "note" for statement in said),
        "excluded": len(excluded_records(said)),
        **{name: info.get("device", {}).get(name, "") for name in ("serial_number", "part")},
        "test": info.get("test", {}).get("result", ""),
        **{name: info.get("test", {}).get(name) for name in ("passed", "missed")},
    }


def _utc(text: str | None) -> str | None:
    """An instant in UTC, so that texts are in the order of time."""
    if text is None:
        return None
    try:
        return datetime.fromisoformat(text).astimezone(UTC).isoformat()
    except ValueError:
        return text


def _ranges(folder: Path | StoredFolder, info: Mapping[str, Any]) -> tuple[ChannelRange, ...]:
    """What the columns range over, by what Parquet keeps of each block; nothing where it is damaged."""
    layout = info["layout"]
    units = dict(
        zip(("time", "record", *layout["channels"], *layout["commands"]), layout["units"], strict=False)
    )
    found = []
    with suppress(RigctlError), open_parquet(folder / samples_file.NAME) as file:
        about = file.metadata
        groups = [about.row_group(number) for number in range(about.num_row_groups)]
        for index, name in enumerate(about.schema.names):
            if name == "record":
                continue
            blocks = [group.column(index).statistics for group in groups]
            kept = [facts for facts in blocks if facts is not None and facts.has_min_max]
            found.append(
                ChannelRange(
                    name,
                    str(units.get(name, "")),
                    "time" if name == "time" else "channel" if name in layout["channels"] else "command",
                    min((facts.min for facts in kept), default=None),
                    max((facts.max for facts in kept), default=None),
                )
            )
    return tuple(found)
