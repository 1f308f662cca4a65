"""The folders of all runs, and the order in which they were made."""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from rigctl.dataset import run_json
from rigctl.dataset.day_folders import is_shard
from rigctl.dataset.recording import log
from rigctl.dataset.run_json import read_info
from rigctl.errors import RigctlError

#: the start of the id of a run
_BEGINS = re.compile(r"\d{8}-\d{6}-")


class Order(NamedTuple):
    """The order of a run: the second in its id, its start to the microsecond, its number."""

    second: str
    began: str
    number: int


def is_run(folder: Path) -> bool:
    """Return whether a folder is a run: it has ``run.json`` or a log; a dot marks one in the making."""
    if folder.name.startswith("."):
        return False
    try:
        return any(stat.S_ISREG(mode) for mode in _modes(folder))
    except PermissionError:  # a run is listed as damaged; 'lost+found' of a disk is none
        return _BEGINS.match(folder.name) is not None


def _modes(folder: Path) -> Iterator[int]:
    """The modes of the files by which a run is recognised, of those that exist."""
    for name in (run_json.NAME, log.NAME):
        try:
            yield (folder / name).stat().st_mode
        except PermissionError:
            raise
        except (OSError, ValueError):
            continue


def run_folders(runs: Path) -> list[Path]:
    """Return the folders of all runs, oldest first; ids begin with their date and time, to the second."""
    by_second: dict[str, list[Path]] = {}
    for folder in sorted(filter(is_run, _entries(runs)), key=_numbered):
        by_second.setdefault(folder.name[:15], []).append(folder)
    for together in by_second.values():
        if len(together) > 1:
            together.sort(key=_began)
    return [folder for together in by_second.values() for folder in together]


def _entries(runs: Path) -> Iterator[Path]:
    """Yield what may be a run, in the runs folder itself and in the folders of days."""
    try:
        with os.scandir(runs) as entries:
            names = [entry.name for entry in entries]
    except (FileNotFoundError, NotADirectoryError):
        return
    for name in names:
        if is_shard(name):
            with os.scandir(runs / name) as entries:
                yield from [runs / name / entry.name for entry in entries]
        else:
            yield runs / name


def order_of(folder: Path, info: Mapping[str, Any]) -> Order:
    """Return the order of one run from its ``run.json``; empty if that cannot be read.

    The data of an import may be years older than the run.
    """
    began = info.get("backend", {}).get("imported") or info.get("started", "")
    return Order(folder.name[:15], str(began), _numbered(folder)[1])


def _began(folder: Path) -> str:
    try:
        return order_of(folder, read_info(folder)).began
    except RigctlError:
        return ""


def _numbered(folder: Path) -> tuple[str, int, str]:
    """Sort by start, then by the number given to runs of the same second."""
    stem, _, number = folder.name.rpartition("-")
    if number.isdigit() and stem and (folder.parent / stem).is_dir():
        return (stem[:15], int(number), folder.name)
    return (folder.name[:15], 1, folder.name)
