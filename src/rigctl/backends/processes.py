"""Whether the process with a given id still exists."""

from __future__ import annotations

import os


def process_exists(pid: int) -> bool:
    """Return whether a process exists; always True on Windows, where the query would end the process."""
    if os.name != "posix":
        return True
    if pid <= 0:  # would query a whole process group
        return False
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except (PermissionError, OverflowError):
        return True
    return True
