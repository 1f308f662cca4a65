"""Machine code of the separate bench, compiled once for all processes of a user.

numba keeps what it compiles, and looks at the file of a function to know whether that is still good: it would
not notice that a function of another file, which is called there, has changed. What is kept therefore lies in
a folder that the text of all files of this package names.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any

from numba import config, njit

from rigctl.files.cache_folder import cache_folder

#: folders that are kept, of the versions of this package that were compiled last
_KEPT = 8


def compiled(function: Callable[..., Any]) -> Any:
    """`function` as machine code, from the user's cache where it is there.

    For what Python calls; what only compiled code calls is compiled into that, and needs no more than
    ``njit``. Where nothing can be written it is compiled in each process.
    """
    folder = folder_of(Path(__file__).parent)
    if folder is None:
        return njit(function)
    with _kept_in(folder):
        return njit(cache=True)(function)


@cache
def folder_of(package: Path) -> Path | None:
    """Folder for the machine code of a package's functions; None if it cannot be kept."""
    content = sha256()
    for path in sorted(package.glob("*.py")):
        content.update(path.read_bytes())
    root = cache_folder() / "separate-bench"
    folder = root / content.hexdigest()[:24]
    try:
        if not folder.is_dir():
            folder.mkdir(parents=True)
            _prune(root)
    except OSError:  # another process has made it, or nothing can be made there
        pass
    return folder if os.access(folder, os.W_OK) else None


def _prune(root: Path) -> None:
    """Delete what is left of earlier versions; a process that has loaded it does not need it again."""
    made = sorted(root.iterdir(), key=lambda path: path.stat().st_mtime, reverse=True)
    for path in made[_KEPT:]:
        shutil.rmtree(path, ignore_errors=True)


@contextmanager
def _kept_in(folder: Path) -> Iterator[None]:
    """Functions that are declared meanwhile are kept there."""
    options: Any = config
    before = options.CACHE_DIR
    options.CACHE_DIR = str(folder)
    try:
        yield
    finally:
        options.CACHE_DIR = before
