"""Waits that end in time on Windows, whose timers tick every 15.6 ms unless a program asks for finer ones.

`time.sleep` has timers of its own there since Python 3.11. Waits for data on a port, a socket or another
thread have not: a device that is to be read a hundred times a second would be read 64 times.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

_FINEST = 1  # ms


@contextmanager
def fine_timers(library: Any = None) -> Iterator[None]:
    """Let waits with a time limit end within some 1 ms of it.

    Parameters
    ----------
    library: Windows' multimedia library; by default that of this system, none elsewhere.
    """
    library = library or _multimedia()
    granted = library is not None and library.timeBeginPeriod(_FINEST) == 0
    try:
        yield
    finally:
        if granted:
            library.timeEndPeriod(_FINEST)


def _multimedia() -> Any:
    if sys.platform == "win32":
        import ctypes

        return ctypes.WinDLL("winmm")
    return None
