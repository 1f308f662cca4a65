"""The end of a console on Windows: its window is closed, its user logs off, or the computer is shut down.

Windows tells a process of it in a thread that it starts for this. It ends the process when that one returns,
or after some seconds (5 for a closed window). So the thread does not return: it is the time that the main
thread has to make outputs safe and to end the process by itself.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

if sys.platform == "win32":
    import ctypes
    import time

    _ENDS = (2, 5, 6)  # CTRL_CLOSE_EVENT, CTRL_LOGOFF_EVENT, CTRL_SHUTDOWN_EVENT
    _LONGEST = 60.0  # s; Windows itself waits less

    _called: list[object] = []  # handlers that do not return, which stay registered

    @contextmanager
    def _handler(ends: Callable[[], None]) -> Iterator[None]:
        def handle(event: int) -> bool:
            if event not in _ENDS:  # Ctrl-C and Ctrl-Break, which the C library makes signals of
                return False
            _called.append(handler)
            ends()
            time.sleep(_LONGEST)
            return True

        handler = ctypes.WINFUNCTYPE(ctypes.c_int, ctypes.c_uint)(handle)  # lives as long as it is registered
        set_handler = ctypes.WinDLL("kernel32").SetConsoleCtrlHandler
        set_handler(handler, True)  # called before those that are registered earlier
        try:
            yield
        finally:
            if handler not in _called:  # the system waits for the one that is called before it removes any
                set_handler(handler, False)


@contextmanager
def console_end(ends: Callable[[], None]) -> Iterator[None]:
    """Call `ends`, from another thread, when the console ends; other systems send a signal for it."""
    if sys.platform == "win32":
        with _handler(ends):
            yield
    else:
        yield
