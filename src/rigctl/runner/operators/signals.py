"""Signals become flags; the runner's loop decides what follows from them."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable
from contextlib import ExitStack
from types import FrameType, TracebackType
from typing import Any, Self

from rigctl.backends.console_end import console_end
from rigctl.errors import ExitCode

#: Ctrl-C
_INTERRUPT = ("SIGINT",)
#: the system, a closed terminal (POSIX), Ctrl-Break (Windows)
_TERMINATE = ("SIGTERM", "SIGHUP", "SIGBREAK")


def _ignored_on_purpose(name: str, number: int) -> bool:
    """Whether the program was started to survive the end of its terminal: by `nohup`."""
    return name == "SIGHUP" and signal.getsignal(number) is signal.SIG_IGN


class Signals:
    """Counts the signals that ask for the end, while it is entered; restores the old handlers afterwards.

    A SIGHUP that is ignored when it is entered, as under `nohup`, stays ignored.

    Outside the main thread, where Python allows no handlers, it does nothing.
    """

    def __init__(self) -> None:
        self.count = 0  #: all of them; the second one skips the cleanup blocks
        self.exit_code = ExitCode.INTERRUPTED  #: description of the first one
        self.name = ""
        self._before: dict[int, Any] = {}
        self._console = ExitStack()

    def __enter__(self) -> Self:
        if threading.current_thread() is threading.main_thread():
            for names, code in ((_INTERRUPT, ExitCode.INTERRUPTED), (_TERMINATE, ExitCode.TERMINATED)):
                for name in names:
                    number = getattr(signal, name, None)
                    if number is not None and not _ignored_on_purpose(name, number):
                        self._before[number] = signal.signal(number, self._handler(name, code))
            self._console.enter_context(console_end(self._console_closed))
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._console.close()
        for number, handler in self._before.items():
            signal.signal(number, handler)
        self._before.clear()

    def _console_closed(self) -> None:
        self._count("closed console", ExitCode.TERMINATED)

    def _handler(self, name: str, code: ExitCode) -> Callable[[int, FrameType | None], None]:
        def count(_number: int, _frame: FrameType | None) -> None:
            self._count(name, code)

        return count

    def _count(self, name: str, code: ExitCode) -> None:
        if self.count == 0:
            self.name, self.exit_code = name, code
        self.count += 1
