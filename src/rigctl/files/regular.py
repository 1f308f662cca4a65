"""Opens files that may come from someone else."""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path

from rigctl.files.in_use import patiently
from rigctl.files.reserved_names import device_named

#: s for a file that is just being replaced
_REPLACED = 0.2


def read_bytes(path: Path) -> bytes:
    """Return the content of a regular file.

    Raises
    ------
    OSError
        as `regular`.
    """
    with open(path, "rb", opener=regular) as file:
        return file.read()


def read_text(path: Path, encoding: str = "utf-8", errors: str | None = None) -> str:
    """Return the text of a regular file, its lines ended by "\\n".

    Raises
    ------
    OSError
        as `regular`.
    UnicodeDecodeError
        it is not in this encoding.
    """
    with open(path, encoding=encoding, errors=errors, opener=regular) as file:
        return file.read()


def regular(path: str, flags: int, *, windows: bool = os.name == "nt") -> int:
    """An ``opener`` for `open` that refuses anything but a regular file: a pipe or a device may never end.

    On Windows a file named like a device is not even opened: that would open the port, and restart its board;
    and one that another program replaces cannot be opened at that moment, which is waited for.

    Raises
    ------
    OSError
        it cannot be opened, or it is a folder, a pipe or a device.
    """
    if windows and (device := device_named(path)) is not None:
        raise OSError(errno.EINVAL, f"{device!r} is a device on Windows, in every folder", path)
    descriptor = patiently(
        lambda: os.open(path, flags | getattr(os, "O_NONBLOCK", 0)),  # opening a pipe would block
        _REPLACED,
        # `os.open` goes through the C library, whose error lacks Windows' number; folders get the same one
        lambda problem: windows and isinstance(problem, PermissionError) and not Path(path).is_dir(),
    )
    mode = os.fstat(descriptor).st_mode
    if stat.S_ISREG(mode):
        return descriptor
    os.close(descriptor)
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), path)
    raise OSError(errno.EINVAL, "it is a pipe or a device, not a file", path)
