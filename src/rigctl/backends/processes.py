"""Whether the process with a given id still exists."""

from __future__ import annotations

import os


def process_exists(pid: int) -> bool:
    """False if there is no such process; on Windows, where the query would end it, always True."""
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
