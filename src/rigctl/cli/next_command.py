"""What to type next: the last line of an answer that leads on."""

from __future__ import annotations

import re
from collections.abc import Sequence

from rich.markup import escape

from rigctl.cli.tables import console

#: what no shell takes for anything else
_PLAIN = re.compile(r"[\w./\\:@+-]+")


def show_next(command: str, why: str) -> None:
    """The command, and below it what it does."""
    console().print(f"\nNext: [bold]{escape(command)}[/]\n  {escape(why)}", soft_wrap=True)


def analysis(
    verb: str, runs: Sequence[str], model: str, *, only: str | None = None, hold_out: str | None = None
) -> str:
    """A command about a model and runs, with the same choice of records: ``rigctl diagnose latest -m …``."""
    words = ["rigctl", verb, *map(_quoted, runs), "--model", _quoted(model)]
    for option, value in (("--only", only), ("--hold-out", hold_out)):
        if value:
            words += [option, f'"{value}"']
    return " ".join(words)


def page_of(
    verb: str, runs: Sequence[str], model: str, *, only: str | None = None, hold_out: str | None = None
) -> str:
    """The command that makes the page of what `verb` said of these records: `report` looks at all of them."""
    if only or hold_out:
        return f"{analysis(verb, runs, model, only=only, hold_out=hold_out)} -o page.html"
    return analysis("report", runs, model) + " --diagnose" * (verb == "diagnose")


def _quoted(text: str) -> str:
    """An argument as every shell takes it."""
    return text if _PLAIN.fullmatch(text) else f'"{text}"'
