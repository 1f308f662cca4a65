"""Progress messages of a long command on stderr, and its message when interrupted."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import monotonic

from rigctl.errors import ExitCode, RigctlError

#: shortest and longest interval between two lines that differ only in their numbers, s
_FIRST, _SPARSE = 2.0, 30.0
_COUNT = re.compile(r":? \d.*")


def _thinned(report: Callable[[str], None], now: Callable[[], float] = monotonic) -> Callable[[str], None]:
    """Suppress lines that repeat an earlier one, counts aside: for `_FIRST` s at first, then ever longer."""
    due: dict[str, tuple[float, float]] = {}  # time of the next line, and the interval after it

    def report_sparsely(text: str) -> None:
        kind, time = _COUNT.sub("", text), now()
        next_time, interval = due.get(kind, (time, _FIRST))
        if time >= next_time:
            due[kind] = time + interval, min(2.0 * interval, _SPARSE)
            report(text)

    return report_sparsely


@contextmanager
def progress_display(
    beginning: str, stopped: str | Callable[[], str] = ""
) -> Iterator[Callable[[str], None]]:
    """Yield a function that is to be called with a description of each step.

    On a terminal it rewrites one line, with the time since the command began, which is removed at the end;
    otherwise it prints a line each time, but counts only now and then, so that a log of hours of work remains
    readable. Only stderr may be printed to meanwhile. What is slow to import is imported within.

    Parameters
    ----------
    beginning: what is done first. A terminal shows it at once, since imports and files alone take seconds on
        a busy computer.
    stopped: the message on the state of the work when Ctrl-C ends it, or a function that returns it.

    Raises
    ------
    RigctlError
        Ctrl-C.
    """
    from rich.markup import escape
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    from rigctl.cli.tables import console

    out = console(stderr=True)
    try:
        if not out.is_terminal:
            yield _thinned(lambda text: out.print(escape(text), soft_wrap=True))
            return
        columns = (SpinnerColumn(), TextColumn("{task.description}", markup=False), TimeElapsedColumn())
        with Progress(*columns, console=out, transient=True) as line:
            task = line.add_task(beginning, total=None)
            yield lambda text: line.update(task, description=text)
    except KeyboardInterrupt:
        state = stopped() if callable(stopped) else stopped
        message = f"Stopped; {state}" if state else "Stopped"
        raise RigctlError(message, exit_code=ExitCode.INTERRUPTED) from None
