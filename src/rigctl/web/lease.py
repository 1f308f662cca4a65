"""The right to command a run: one window at a time has it, visible to all, and another can take it over."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from time import monotonic
from typing import Final

from rigctl.errors import ExitCode, RigctlError

#: s after which a closed window loses the right: a reload takes less
_GONE: Final = 10.0


@dataclass
class _Window:
    number: int
    seen: float
    open: int = 0  # its connections


class Lease:
    """The right to command, among the windows of one server.

    A window that gives a command while nobody has the right gets it. Making the bench safe does not need it.
    """

    def __init__(self) -> None:
        self._windows: dict[str, _Window] = {}
        self._holder = ""
        self._count = 0
        self._lock = threading.Lock()

    def connected(self, viewer: str) -> int:
        """Register a window; returns its number."""
        with self._lock:
            window = self._window(viewer)
            window.open += 1
            return window.number

    def disconnected(self, viewer: str) -> None:
        """Unregister a window."""
        with self._lock:
            window = self._window(viewer)
            window.open = max(window.open - 1, 0)
            window.seen = monotonic()
            # Windows that are long gone are forgotten; one that is only reloaded keeps its number and the
            # controls.
            for name in [name for name in self._windows if not self._is_present(name)]:
                del self._windows[name]

    def take(self, viewer: str, *, over: bool) -> None:
        """Acquire the right to command.

        Raises
        ------
        RigctlError
            another window has it, and `over` does not take it over.
        """
        with self._lock:
            window = self._window(viewer)
            window.seen = monotonic()
            if self._holder not in ("", viewer) and self._is_present(self._holder) and not over:
                raise RigctlError(
                    f"window {self._windows[self._holder].number} has the controls",
                    hint="'Take over' takes them away from it",
                    exit_code=ExitCode.FAILED,
                )
            self._holder = viewer

    def give(self, viewer: str) -> None:
        """Release the right; no effect if another window has it."""
        with self._lock:
            if self._holder == viewer:
                self._holder = ""

    def seen_by(self, viewer: str) -> dict[str, object]:
        """The state of the right for a window."""
        with self._lock:
            holder = self._holder if self._holder and self._is_present(self._holder) else ""
            mine = self._windows.get(viewer)
            return {
                "holder": self._windows[holder].number if holder else None,
                "mine": bool(holder) and holder == viewer,
                "window": mine.number if mine else None,
                "viewers": sum(window.open > 0 for window in self._windows.values()),
            }

    def _window(self, viewer: str) -> _Window:
        if not viewer:
            raise RigctlError("a window needs a name to command with")
        window = self._windows.get(viewer)
        if window is None:
            self._count += 1
            window = self._windows[viewer] = _Window(self._count, monotonic())
        return window

    def _is_present(self, viewer: str) -> bool:
        window = self._windows.get(viewer)
        return window is not None and (window.open > 0 or monotonic() - window.seen < _GONE)
