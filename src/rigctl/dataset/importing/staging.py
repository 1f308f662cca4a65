"""Atomic creation of an imported run: it is made in a hidden folder, then renamed.

An import that is interrupted, even by a kill, leaves nothing that looks like a run; a later import removes
what a killed one has left.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import mkdtemp
from typing import Final

from rigctl.dataset.day_folders import folder_for
from rigctl.dataset.recording.writer_lock import in_progress
from rigctl.errors import Location, RigctlError
from rigctl.files.write import move_folder

#: prefix of unfinished folders; a dot hides them from the catalogue
_PREFIX: Final = ".import-"
#: age from which an unlocked folder is considered abandoned, s
_LEFT_BEHIND: Final = 3600.0


class NameTakenError(RigctlError):
    """Another import has taken the name of a run in the same second."""


@contextmanager
def staged(runs: Path) -> Iterator[Path]:
    """Provide a folder in `runs` in which to make the run; what is left in it is removed.

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
    """Move a complete run to its place among the others.

    Raises
    ------
    NameTakenError
        another import has taken the name in the same second.
    RigctlError
        the run cannot be moved there.
    """
    target = folder_for(runs, folder.name) / folder.name
    try:
        target.parent.mkdir(exist_ok=True)
        if target.exists():  # an empty folder would be replaced
            raise FileExistsError(target)
        return move_folder(folder, target)
    except OSError as problem:
        if not target.exists():
            raise RigctlError(
                f"cannot put the run in its place: {problem.strerror}", where=Location(target)
            ) from problem
        raise NameTakenError(
            "another import took this name in the same second", where=Location(target), hint="Try again"
        ) from problem


def _sweep(runs: Path) -> None:
    """Remove the remains of killed imports."""
    for folder in runs.glob(f"{_PREFIX}*"):
        with suppress(OSError):
            old = time.time() - folder.stat().st_mtime > _LEFT_BEHIND
            if old and not any(in_progress(run) for run in folder.iterdir()):
                shutil.rmtree(folder, ignore_errors=True)
