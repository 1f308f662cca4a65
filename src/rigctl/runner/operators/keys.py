"""The keys of a run, read from a terminal without blocking; whole lines if there is no terminal.

In: stdin. Out: the characters typed since the last call, for `rigctl.runner.operators.console`. Three
kinds of input need three ways not to block: a POSIX terminal is put into a mode that delivers each key,
and is asked whether there is one; the Windows console has functions for this; a pipe or a file is read by
a thread. A terminal is left as it was found, however the program ends.
"""

from __future__ import annotations

import os
import queue
import stat
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Protocol, TextIO

from rigctl.runner.operators.requests import Request

if sys.platform == "win32":
    from rigctl.runner.operators import windows_input

#: request of each key to a run in progress, with its description
KEYS = {"p": Request.PAUSE, "c": Request.CONTINUE, "a": Request.ABORT, "q": Request.ABORT}
HELP = "p pause, c continue, a or q end the run"


class Keys(Protocol):
    """Characters as they are typed."""

    interactive: bool
    ended: bool  #: whether no further input can come

    def read(self) -> str:
        """Characters typed since the last call; does not block."""
        ...

    def close(self) -> None:
        """Leave the terminal as it was; never raises, idempotent."""
        ...


def open_keys(stream: TextIO | None = None) -> Keys:
    """The keys of a terminal, or the lines of another stream."""
    source = stream or sys.stdin
    if not is_terminal(source):
        return _Lines(source)
    if os.name == "nt":
        return _WindowsKeys()
    # Reading in the background would stop the whole process (SIGTTIN), and with it the interlocks.
    if _in_foreground(source.fileno()):
        return _PosixKeys(source.fileno())
    return _Lines(None)


def is_terminal(stream: TextIO | None) -> bool:
    """Whether a person can type into the stream."""
    try:
        if stream is None or not stream.isatty():
            return False
        # Windows calls every character device a terminal, the null device too
        return sys.platform != "win32" or windows_input.is_console(stream.fileno())
    except (OSError, ValueError):  # not a file of the operating system, or closed
        return False


def input_is_empty(stream: TextIO | None = None) -> bool:
    """Whether no line can be read: a closed input, the null device, the end of a file or of a pipe."""
    source = stream or sys.stdin
    if source is None or source.closed:
        return True
    try:
        descriptor = source.fileno()
        mode = os.fstat(descriptor).st_mode
        if stat.S_ISREG(mode):
            return os.lseek(descriptor, 0, os.SEEK_CUR) >= os.fstat(descriptor).st_size
        if stat.S_ISCHR(mode):
            return _is_null_device(descriptor)
        return stat.S_ISFIFO(mode) and _is_drained(descriptor)
    except (OSError, ValueError):  # not a file of the operating system
        return False


def _is_null_device(descriptor: int) -> bool:
    if sys.platform == "win32":
        return not windows_input.is_console(descriptor)
    return os.path.samestat(os.fstat(descriptor), os.stat(os.devnull))  # noqa: PTH116


def _is_drained(pipe: int) -> bool:
    """Whether a pipe holds nothing, and nobody can write to it any more."""
    if sys.platform == "win32":
        return windows_input.is_drained(pipe)
    import select

    poll = select.poll()
    poll.register(pipe, select.POLLIN)
    return any(event & select.POLLHUP and not event & select.POLLIN for _, event in poll.poll(0))


def _in_foreground(descriptor: int) -> bool:
    """True unless the shell has put the program into the background, where reading would stop it."""
    try:
        return os.tcgetpgrp(descriptor) == os.getpgrp()
    except OSError:
        return False


class _PosixKeys:
    """A terminal that delivers every key at once, without echo."""

    interactive = True

    def __init__(self, descriptor: int) -> None:
        import codecs
        import termios
        import tty

        self.ended = False  # the terminal is closed, and the program was started to survive that
        self._descriptor = descriptor
        self._before: Any = termios.tcgetattr(descriptor)
        self._decode = codecs.getincrementaldecoder("utf-8")("replace").decode
        # Keys at once and without echo, while Ctrl-C still makes a signal.
        tty.setcbreak(descriptor, termios.TCSADRAIN)

    def read(self) -> str:
        import select

        with suppress(ValueError):
            if not self.ended and select.select([self._descriptor], [], [], 0.0)[0]:
                try:
                    typed = os.read(self._descriptor, 1024)
                except BlockingIOError:  # another program has read it
                    return ""
                except OSError:  # Linux: EIO
                    self.ended = True
                    return ""
                self.ended = not typed and not os.isatty(self._descriptor)  # a Ctrl-D is none of its ends
                return self._decode(typed)
        return ""

    def close(self) -> None:
        import termios

        before, self._before = self._before, None
        if before is not None:
            with suppress(termios.error, OSError):
                termios.tcsetattr(self._descriptor, termios.TCSADRAIN, before)


class _WindowsKeys:
    """The console's own key functions."""

    interactive = True
    ended = False

    def __init__(self) -> None:
        import importlib

        console = importlib.import_module("msvcrt")
        self._waiting: Callable[[], bool] = console.kbhit
        self._key: Callable[[], str] = console.getwch

    def read(self) -> str:
        typed = ""
        while self._waiting():
            key = self._key()
            if key in ("\x00", "\xe0"):  # a function key: the code that follows has no meaning here
                self._key()
            else:
                typed += "\n" if key == "\r" else key
        return typed

    def close(self) -> None: ...


class _Lines:
    """A pipe or a file: read by a thread, since only a thread can wait for one everywhere."""

    interactive = False

    def __init__(self, stream: TextIO | None) -> None:
        self._lines: queue.SimpleQueue[str] = queue.SimpleQueue()
        self.ended = stream is None or stream.closed
        if stream is not None and not self.ended:
            # A daemon: a pipe from which nothing comes must not keep the program from ending.
            threading.Thread(target=self._read, args=(stream,), daemon=True).start()

    def _read(self, stream: TextIO) -> None:
        with suppress(OSError, ValueError):
            for line in stream:
                self._lines.put(line if line.endswith("\n") else line + "\n")
        self.ended = True

    def read(self) -> str:
        typed = ""
        with suppress(queue.Empty):
            while True:
                typed += self._lines.get_nowait()
        return typed

    def close(self) -> None: ...
