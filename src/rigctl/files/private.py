"""Folders of the user alone: what others could write there must be neither executed nor believed.

On POSIX the owner and the permissions decide. Windows has no such permissions; there a folder counts as
private below the user's profile, which other users cannot write to by default.
"""

from __future__ import annotations

import os
import stat
from pathlib import Path
from typing import Final

#: permissions of group and others to write
_OTHERS: Final = stat.S_IWGRP | stat.S_IWOTH


def private_folder(folder: Path) -> None:
    """Make a folder that only this user can write to; the user's own loses the permission for others.

    Files that were in it before must be checked by `is_private`, and by their content for their names.

    Raises
    ------
    OSError
        it belongs to another user, cannot be made, or its permissions cannot be changed.
    """
    if not folder.is_dir():
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    if is_private(folder):
        return
    if hasattr(os, "geteuid") and folder.stat().st_uid == os.geteuid():
        folder.chmod(stat.S_IMODE(folder.stat().st_mode) & ~_OTHERS)
    if not is_private(folder):
        raise PermissionError(f"{folder.as_posix()} can be changed by other users")


def is_private(path: Path) -> bool:
    """Whether a file or folder belongs to this user, or to root, and nobody else may write to it.

    Raises
    ------
    OSError
        there is none.
    """
    if not hasattr(os, "geteuid"):
        return path.resolve(strict=True).is_relative_to(Path.home().resolve())
    facts = path.stat()
    return facts.st_uid in (os.geteuid(), 0) and not facts.st_mode & _OTHERS
