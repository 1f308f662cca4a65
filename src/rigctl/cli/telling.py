"""What a command that takes a while says meanwhile, on stderr."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def telling() -> Iterator[Callable[[str], None]]:
    """Give a function that is told what is being done.

    On a terminal it is one line that changes and goes when the work is done; else a line each.
    """
    from rich.console import Console
    from rich.markup import escape

    console = Console(stderr=True, highlight=False)
    if not console.is_terminal:
        yield lambda text: console.print(escape(text), soft_wrap=True)
        return
    with console.status("Beginning") as status:
        yield lambda text: status.update(escape(text))
