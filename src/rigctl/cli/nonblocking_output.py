"""Non-blocking output: a terminal that is not read delays neither a run nor its end.

A terminal stopped by Ctrl-S, or a pipe whose reader hangs, blocks whoever writes to it. A thread for each
stream is blocked in place of the run; what waits is bounded, and the oldest is dropped. At the end the
process waits a few seconds for its last words to be read, and then ends without them. See
docs/decisions/0047-slow-readers-never-block-a-run.md.
"""

from __future__ import annotations

import io
import os
import sys
import threading
from collections import deque
from collections.abc import Callable
from time import monotonic
from typing import Any, TextIO

from rigctl.cli.closed_output import UNREAD

#: commands that operate a bench, and whose output may be dropped if nobody reads it
ON_A_BENCH = ("run", "simulate", "resume", "jog", "off")
_LAST_WORDS = 3.0  # time-out at the end for the output to be read, s
_WAITING = 1 << 20  # most waiting characters; beyond that, the oldest are dropped


class Outlet(io.TextIOBase):
    """A text stream whose `write` never blocks; a thread passes on what was written.

    Parameters
    ----------
    stream: the destination.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._waiting: deque[str] = deque()
        self._size = 0
        self._busy = False
        self._trouble: OSError | None = None
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._work, name="output", daemon=True)
        self._thread.start()

    def write(self, text: str) -> int:
        """Accept text; an earlier failure to pass text on is raised here, once."""
        if not isinstance(text, str):  # how click finds out what kind of stream it is
            raise TypeError(f"text is needed, not {type(text).__name__}")
        with self._changed:
            trouble, self._trouble = self._trouble, None
            if trouble is not None:
                raise trouble
            self._waiting.append(text)
            self._size += len(text)
            # The newest text is always kept: it says how the run ended.
            while self._size > _WAITING and len(self._waiting) > 1:
                self._size -= len(self._waiting.popleft())
            self._changed.notify_all()
        return len(text)

    def drain(self, patience: float) -> bool:
        """Wait until all text is passed on, at most `patience` s; False if it is not.

        Raises
        ------
        OSError
            it could not be passed on: the other end is closed, or the disk is full.
        """
        with self._changed:
            done = self._changed.wait_for(
                lambda: self._trouble is not None or not (self._waiting or self._busy), patience
            )
            trouble, self._trouble = self._trouble, None
        if trouble is not None:
            raise trouble
        return done

    def settle(self, patience: float) -> None:
        """Wait as `drain` does; a failure is left for the next `write` or `drain`."""
        with self._changed:
            self._changed.wait_for(
                lambda: self._trouble is not None or not (self._waiting or self._busy), patience
            )

    def flush(self) -> None:
        """No effect: the thread flushes."""

    def writable(self) -> bool:
        """True."""
        return True

    def isatty(self) -> bool:
        """Whether the destination is a terminal."""
        return self._stream.isatty()

    def fileno(self) -> int:
        """File descriptor of the destination."""
        return self._stream.fileno()

    @property
    def encoding(self) -> str:  # type: ignore[override]
        """Encoding of the destination."""
        return self._stream.encoding

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def _work(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting)
                text = "".join(self._waiting)
                self._waiting.clear()
                # Taken out under the lock, written without it: `write` never waits for the stream.
                self._size, self._busy = 0, True
            trouble: OSError | None = None
            try:
                self._stream.write(text)
                self._stream.flush()
            except (OSError, ValueError) as problem:  # ValueError: closed
                trouble = problem if isinstance(problem, OSError) else OSError(str(problem))
            with self._changed:
                self._trouble, self._busy = trouble or self._trouble, False
                self._changed.notify_all()


def finish_display() -> None:
    """Wait until what was written to stderr is passed on, before results are written to stdout.

    Each stream has a thread: on a terminal, the last picture of the display would erase them.
    """
    if isinstance(sys.stderr, Outlet):
        sys.stderr.settle(_LAST_WORDS)


def carry_out(work: Callable[[], None]) -> None:
    """Run a command with non-blocking output, and end the process with its exit code.

    If nobody reads the last lines, the process ends without them: the results are in the run's files.
    """
    usual = sys.stdout, sys.stderr
    if None in usual:
        work()
        return
    outlets = (Outlet(usual[0]), Outlet(usual[1]))
    sys.stdout, sys.stderr = outlets
    code: Any = 0
    try:
        work()
    except SystemExit as end:
        code = end.code
    finally:
        all_written, lost = _flush_outlets(outlets)
        sys.stdout, sys.stderr = usual
        if lost or not all_written:  # flushing would block again on what is left in the streams
            os._exit((code if isinstance(code, int) else 1) or lost)
    sys.exit(code)


def _flush_outlets(outlets: tuple[Outlet, Outlet]) -> tuple[bool, int]:
    """Whether all text was passed on, and the exit status if some is lost: a closed pipe, a full disk."""
    give_up = monotonic() + _LAST_WORDS
    all_written, lost = True, 0
    for outlet in outlets:
        try:
            all_written = outlet.drain(max(give_up - monotonic(), 0.0)) and all_written
        except BrokenPipeError:
            lost = lost or UNREAD
        except OSError:
            lost = 1
        except KeyboardInterrupt:
            all_written = False
    return all_written, lost
