"""Progress messages of a long command on stderr, and its message when interrupted."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import monotonic

from rigctl.errors import ExitCode, RigctlError

#: interval between two lines that differ only in their numbers, s
_SPARSE = 30.0
_COUNT = re.compile(r"\d+(?:[.,]\d+)?")


def _thinned(report: Callable[[str], None], now: Callable[[], float] = monotonic) -> Callable[[str], None]:
    """Suppress lines that repeat the last one, numbers aside, until `_SPARSE` s have passed."""
    last: dict[str, float] = {}

    def report_sparsely(text: str) -> None:
        kind, time = _COUNT.sub("0", text), now()
        if time - last.get(kind, -_SPARSE) >= _SPARSE:
            last[kind] = time
            report(text)

    return report_sparsely


@contextmanager
def first_sign(text: str) -> Iterator[None]:
    """Show on a terminal, while something is read that takes seconds on a busy computer, what is being done.

    Nothing else may rewrite the terminal meanwhile, as `progress_display` does.
    """
    from rich.markup import escape

    from rigctl.cli.tables import console

    out = console(stderr=True)
    if not out.is_terminal:
        yield
        return
    with out.status(escape(text)):
        yield


@contextmanager
def progress_display(stopped: str = "") -> Iterator[Callable[[str], None]]:
    """Yield a function that is to be called with a description of each step.

    On a terminal it rewrites one line, which is removed at the end; otherwise it prints a line each time, but
    counts only now and then, so that a log of hours of work remains readable.

    Parameters
    ----------
    stopped: the message on the state of the work when Ctrl-C ends it.

    Raises
    ------
    RigctlError
        Ctrl-C.
    """
    from rich.markup import escape

    from rigctl.cli.tables import console

    out = console(stderr=True)
    try:
        if not out.is_terminal:
            yield _thinned(lambda text: out.print(escape(text), soft_wrap=True))
            return
        with out.status("Beginning") as status:
            yield lambda text: status.update(escape(text))
    except KeyboardInterrupt:
        message = f"Stopped; {stopped}" if stopped else "Stopped"
        raise RigctlError(message, exit_code=ExitCode.INTERRUPTED) from None
