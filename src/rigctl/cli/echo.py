"""Output of commands: lines for people, documents for programs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import typer

from rigctl.printable import printable


def echo(text: str = "", *, err: bool = False) -> None:
    """Print a line on stdout or stderr, without terminal control characters."""
    typer.echo(printable(text, keep="\n\t"), err=err)  # noqa: TID251


def print_json(document: Mapping[str, Any], *, indent: int | None = 2) -> None:
    """Print one JSON document on stdout; it escapes control characters, and programs read the others back."""
    from rigctl.files.write import to_json

    typer.echo(to_json(document, indent=indent))  # noqa: TID251
