"""A console window that is closed on Windows, on which Windows ends the programs in it.

Windows starts a thread in each of them that calls its handlers, the newest first. It ends the process when
one has answered, or after some 5 s. So ours does not return: that is the time that the main thread has to
make outputs safe and to end the process by itself.

The end of a session gives no such time: Windows ends a program of a user who logs off, or when it shuts down,
without a call. Only services are called for it.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

_CLOSED, _LOGGED_OFF = 2, 5  # CTRL_CLOSE_EVENT, CTRL_LOGOFF_EVENT
_LONGEST = 60.0  # s; Windows itself waits less


def handled(event: int, closed: Callable[[], None], wait: Callable[[float], None] = time.sleep) -> bool:
    """Answer a console event as a handler does; return False to leave it to the handler before this one.

    That is the C library's, which makes the signal SIGINT of Ctrl-C, and SIGBREAK of everything else.

    Parameters
    ----------
    event: the number by which Windows names it.
    closed: called when the window was closed, before the wait that keeps the process.
    wait: pauses this thread, for s.
    """
    if event == _CLOSED:
        closed()
        wait(_LONGEST)
    return event in (_CLOSED, _LOGGED_OFF)  # a service is told of any user who logs off: no reason to end


if sys.platform == "win32":
    import ctypes

    _called: list[object] = []  # handlers that do not return, which stay registered

    @contextmanager
    def _handler(closed: Callable[[], None]) -> Iterator[None]:
        def stays() -> None:
            _called.append(handler)
            closed()

        def handle(event: int) -> bool:
            return handled(event, stays)

        handler = ctypes.WINFUNCTYPE(ctypes.c_int, ctypes.c_uint)(handle)  # lives as long as it is registered
        set_handler = ctypes.WinDLL("kernel32").SetConsoleCtrlHandler
        set_handler(handler, True)  # called before those that are registered earlier
        try:
            yield
        finally:
            if handler not in _called:  # the system waits for the one that is called before it removes any
                set_handler(handler, False)


@contextmanager
def console_end(closed: Callable[[], None]) -> Iterator[None]:
    """Call `closed`, from another thread, when the console window is closed; elsewhere a signal says so."""
    if sys.platform == "win32":
        with _handler(closed):
            yield
    else:
        yield
