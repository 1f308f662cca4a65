"""What a command that takes a while says meanwhile, on stderr, and when it is stopped."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import monotonic

from rigctl.errors import ExitCode, RigctlError

#: s between two lines that differ in their numbers alone
_SPARSE = 30.0
_COUNT = re.compile(r"\d+(?:[.,]\d+)?")


def _thinned(tell: Callable[[str], None], now: Callable[[], float] = monotonic) -> Callable[[str], None]:
    """Leave out what was just said with other numbers, or word for word, until `_SPARSE` have passed."""
    last: dict[str, float] = {}

    def told(text: str) -> None:
        kind, time = _COUNT.sub("0", text), now()
        if time - last.get(kind, -_SPARSE) >= _SPARSE:
            last[kind] = time
            tell(text)

    return told


@contextmanager
def telling(stopped: str = "") -> Iterator[Callable[[str], None]]:
    """Give a function that is called with a description of the current step.

    On a terminal it is one line that changes and goes when the work is done; else a line each, but of what
    is counted one at most in a while, so that a log of hours of work can be read.

    Parameters
    ----------
    stopped: said of what is left of the work when Ctrl-C ends it.

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
        said = f"Stopped; {stopped}" if stopped else "Stopped"
        raise RigctlError(said, exit_code=ExitCode.INTERRUPTED) from None
