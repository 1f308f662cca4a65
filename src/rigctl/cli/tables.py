"""Tables as every command prints them."""

from __future__ import annotations

from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from rigctl.printable import printable

_PIPED_WIDTH = 160


class PrintableConsole(Console):
    """A console that strips terminal control characters from texts of files and devices."""

    def render_str(self, text: str, **options: Any) -> Text:
        """A text, which may have markup, without terminal control characters."""
        return super().render_str(printable(text, keep="\n\t"), **options)


def console(*, piped_width: int = _PIPED_WIDTH, **options: Any) -> Console:
    """A console that does not wrap tables when it is piped; `options` as of `rich.console.Console`."""
    output = PrintableConsole(highlight=False, **options)
    if not output.is_terminal:
        output.width = piped_width
    return output


def table(*columns: str) -> Table:
    """An empty table with a line under its head; long cells are folded."""
    grid = Table(box=SIMPLE_HEAD, pad_edge=False)
    for column in columns:
        grid.add_column(column, overflow="fold")
    return grid
