"""Names of earlier versions of a file: ``m.yaml@3`` is version 3 of ``m.yaml``."""

from __future__ import annotations

import re
from pathlib import Path

_VERSION = re.compile(r"(.*[^@])@([0-9]{1,6})", re.DOTALL)


def split_version(path: Path) -> tuple[Path, int | None]:
    """Return the path of the file, and the number of the version; None for the current file.

    An existing file with such a name takes precedence.
    """
    match = _VERSION.fullmatch(path.name)
    if match is None or _is_there(path):
        return path, None
    return path.with_name(match[1]), int(match[2])


def with_version(head: Path, number: int) -> Path:
    """Return the path of a version: the inverse of `split_version`."""
    return head.with_name(f"{head.name}@{number}")


def path_exists(path: Path) -> bool:
    """Return whether there is such a file or folder, or the file of which it names a version.

    False for a name that the file system does not allow.
    """
    return _is_there(path) or _is_there(split_version(path)[0])


def _is_there(path: Path) -> bool:
    try:
        return path.exists()
    except (OSError, ValueError):
        return False
