"""The choice of a display for a stream."""

from __future__ import annotations

import os
import sys
from types import TracebackType
from typing import Protocol, Self, TextIO

from rigctl.plan import Plan
from rigctl.runner.snapshot import View


class Display(Protocol):
    """An observer of a run: called with every view, in a ``with`` block for the duration of the run."""

    interactive: bool  #: whether it shows questions and answers itself

    def __enter__(self) -> Self:
        """Begin to show."""
        ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Show the last view and restore the terminal."""
        ...

    def __call__(self, view: View) -> None:
        """Take a view; returns at once, whatever the terminal does."""
        ...


def view(plan: Plan, stream: TextIO | None = None, *, hint: str = "") -> Display:
    """The display of a run: redrawn on a terminal, one line per event elsewhere.

    Parameters
    ----------
    stream: the destination; stderr, so that stdout is left for results.
    hint: the keys and their meaning, shown below.
    """
    target = sys.stderr if stream is None else stream
    if redrawable(target):
        from rigctl.live.terminal import TerminalDisplay

        return TerminalDisplay(plan, target, hint=hint)
    from rigctl.live.plain import PlainDisplay

    return PlainDisplay(plan, target)


def redrawable(stream: TextIO) -> bool:
    """True for a terminal whose cursor can be moved."""
    try:
        return stream.isatty() and os.environ.get("TERM", "") != "dumb"
    except ValueError:  # closed
        return False
