"""The place of a run: directly in the runs folder or, if there are many runs, in a folder for each day.

``runs/20261121-093000-stroke`` and ``runs/2026-11-21/20261121-093000-stroke`` are equivalent. Existing runs
are never moved: only new runs get a day's folder.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Final

#: entries in a runs folder from which new runs get a folder for each day
SHARD_FROM: Final = 1000
_DAY: Final = re.compile(r"\d{4}-\d{2}-\d{2}")
_ID: Final = re.compile(r"(\d{4})(\d{2})(\d{2})-\d{6}-")


def is_shard(name: str) -> bool:
    """Return whether a folder of this name is for the runs of a day."""
    return _DAY.fullmatch(name) is not None


def shard_of(run_id: str) -> str | None:
    """Return the day's folder for a run of this id: ``2026-11-21``; None for other ids."""
    match = _ID.match(run_id)
    return "-".join(match.groups()) if match else None


def folder_for(runs: Path, run_id: str) -> Path:
    """Return the folder in which to make a new run of this id, without making it."""
    shard = shard_of(run_id)
    return runs / shard if shard is not None and _has_many(runs, shard) else runs


def _has_many(runs: Path, shard: str) -> bool:
    if (runs / shard).is_dir():
        return True
    try:
        with os.scandir(runs) as entries:
            names = [entry.name for entry in islice(entries, SHARD_FROM)]
    except FileNotFoundError:
        return False
    return len(names) >= SHARD_FROM or any(map(is_shard, names))


def places_of(runs: Path, run_id: str) -> Iterator[Path]:
    """Return the possible places of a run of this id."""
    yield runs / run_id
    shard = shard_of(run_id)
    if shard is not None:
        yield runs / shard / run_id


def is_taken(runs: Path, run_id: str) -> bool:
    """Return whether this name exists, directly in the runs folder or in its day's."""
    return any(path.exists() for path in places_of(runs, run_id))


def runs_root(folder: Path) -> Path:
    """Return the runs folder that contains a run's folder."""
    return folder.parent.parent if is_shard(folder.parent.name) else folder.parent
