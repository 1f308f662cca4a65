"""Output of commands: lines for people, documents for programs."""

from __future__ import annotations

import typer

from rigctl.printable import printable


def echo(text: str = "", *, err: bool = False) -> None:
    """Print a line on stdout or stderr, without terminal control characters."""
    typer.echo(printable(text, keep="\n\t"), err=err)  # noqa: TID251


def echo_json(document: str) -> None:
    """Print JSON on stdout as it is: it escapes control characters, and programs read the others back."""
    typer.echo(document)  # noqa: TID251
