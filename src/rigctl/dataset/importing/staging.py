"""A run that comes in whole or not at all: made out of sight, then given its name in one step.

Whatever ends an import, a kill too, leaves nothing that looks like a run; what a killed one has left behind
is swept up by a later one.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import mkdtemp
from typing import Final

from rigctl.dataset.shards import folder_for
from rigctl.dataset.writer_lock import in_progress
from rigctl.errors import Location, RigctlError

#: how folders begin that are no runs yet; a dot hides them from the catalogue
_PREFIX: Final = ".import-"
#: a folder that nobody writes to and that is this old was left behind, s
_LEFT_BEHIND: Final = 3600.0


@contextmanager
def staged(runs: Path) -> Iterator[Path]:
    """A folder in `runs` to make the run in; what is still in it at the end is removed.

    Raises
    ------
    RigctlError
        the folder cannot be made.
    """
    try:
        runs.mkdir(parents=True, exist_ok=True)
        _sweep(runs)
        folder = Path(mkdtemp(prefix=_PREFIX, dir=runs))
    except OSError as problem:
        raise RigctlError(
            f"cannot make a folder for the run: {problem.strerror}",
            where=Location(runs),
            hint="Choose another folder with 'runs = \"…\"' in rigctl.toml",
        ) from problem
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def publish(folder: Path, runs: Path) -> Path:
    """Give a whole run its place among the others.

    Raises
    ------
    RigctlError
        another import took the name in the same second.
    """
    place = folder_for(runs, folder.name) / folder.name
    try:
        place.parent.mkdir(exist_ok=True)
        return folder.rename(place)
    except OSError as problem:
        if not place.exists():
            raise RigctlError(
                f"cannot put the run in its place: {problem.strerror}", where=Location(place)
            ) from problem
        raise RigctlError(
            "another import has taken this name in the same second", where=Location(place), hint="Try again"
        ) from problem


def _sweep(runs: Path) -> None:
    """Remove what killed imports have left behind."""
    for folder in runs.glob(f"{_PREFIX}*"):
        with suppress(OSError):
            old = time.time() - folder.stat().st_mtime > _LEFT_BEHIND
            if old and not any(in_progress(run) for run in folder.iterdir()):
                shutil.rmtree(folder, ignore_errors=True)
