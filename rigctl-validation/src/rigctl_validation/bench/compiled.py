"""Machine code of the separate bench, compiled once for all processes of a user.

numba caches compiled functions, and invalidates an entry when the function's own file changes: it would not
notice a change of a called function in another file. The name of the cache folder is therefore a hash of all
files of the function's package.
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
from rigctl.files.private import private_folder

#: number of cache folders that are kept, those of the latest versions of this package
_KEPT = 8


def compiled(function: Callable[..., Any]) -> Any:
    """`function` as machine code, from the user's cache if possible.

    For functions called from Python; those called only from compiled code are compiled into their callers
    and need only ``njit``. Without a writable cache it is compiled in each process.
    """
    folder = folder_of(Path(function.__code__.co_filename).parent)
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
        _make_unreachable(root)
        if not folder.is_dir():
            folder.mkdir(parents=True)
            _prune(root)
    except FileExistsError:  # another process has made it
        pass
    except OSError:  # it cannot be made, or is another user's
        return None
    return folder if os.access(folder, os.W_OK) else None


def _make_unreachable(root: Path) -> None:
    """Make a folder that others cannot enter: numba's files in it are executed, whoever wrote them.

    One that others could enter is made anew.
    """
    if root.exists() and hasattr(os, "geteuid") and root.stat().st_mode & 0o077:
        shutil.rmtree(root, ignore_errors=True)
    private_folder(root)


def _prune(root: Path) -> None:
    """Delete the folders of earlier versions; a process that has loaded one does not need it again."""
    folders = sorted(root.iterdir(), key=lambda path: path.stat().st_mtime, reverse=True)
    for path in folders[_KEPT:]:
        shutil.rmtree(path, ignore_errors=True)


@contextmanager
def _kept_in(folder: Path) -> Iterator[None]:
    """Cache functions that are declared within the context in this folder."""
    options: Any = config
    before = options.CACHE_DIR
    options.CACHE_DIR = str(folder)
    try:
        yield
    finally:
        options.CACHE_DIR = before
