"""What a command that takes a while says meanwhile, on stderr, and when it is stopped."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rigctl.errors import ExitCode, RigctlError


@contextmanager
def telling(stopped: str = "") -> Iterator[Callable[[str], None]]:
    """Give a function that is told what is being done.

    On a terminal it is one line that changes and goes when the work is done; else a line each.

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
            yield lambda text: out.print(escape(text), soft_wrap=True)
            return
        with out.status("Beginning") as status:
            yield lambda text: status.update(escape(text))
    except KeyboardInterrupt:
        said = f"Stopped; {stopped}" if stopped else "Stopped"
        raise RigctlError(said, exit_code=ExitCode.INTERRUPTED) from None
