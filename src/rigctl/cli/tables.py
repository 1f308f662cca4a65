"""Tables and JSON documents as every command prints them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from rigctl.files.write import to_json

_PIPED_WIDTH = 160


def print_json(document: Mapping[str, Any]) -> None:
    """One JSON document on stdout."""
    typer.echo(to_json(document))


def console() -> Console:
    """A console that does not wrap tables when it is piped."""
    made = Console(highlight=False)
    if not made.is_terminal:
        made.width = _PIPED_WIDTH
    return made


def table(*columns: str) -> Table:
    """An empty table with a line under its head; long cells are folded."""
    made = Table(box=SIMPLE_HEAD, pad_edge=False)
    for column in columns:
        made.add_column(column, overflow="fold")
    return made
