"""Opens files that somebody else may have made."""

from __future__ import annotations

import errno
import os
import stat


def regular(path: str, flags: int) -> int:
    """The ``opener`` of `open` that refuses what is not a file: a pipe or a device never ends.

    Raises
    ------
    OSError
        it cannot be opened, or it is a folder, a pipe or a device.
    """
    descriptor = os.open(path, flags | getattr(os, "O_NONBLOCK", 0))  # a pipe would be waited for
    mode = os.fstat(descriptor).st_mode
    if stat.S_ISREG(mode):
        return descriptor
    os.close(descriptor)
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), path)
    raise OSError(errno.EINVAL, "it is a pipe or a device, not a file", path)
