"""What to type next: the last line of an answer that leads on."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from rich.markup import escape

from rigctl.cli.tables import console

#: what no shell takes for anything else
_PLAIN = re.compile(r"[\w./\\:@+=-]+")


def show_next(command: str, why: str) -> None:
    """The command, and below it what it does."""
    console().print(f"\nNext: [bold]{escape(command)}[/]\n  {escape(why)}", soft_wrap=True)


@dataclass(frozen=True)
class DataOptions:
    """What an analysis was told of its runs besides their names, and the next one must be told again.

    Attributes
    ----------
    only, hold_out: expressions that choose records.
    assume: ``NAME=VALUE`` of inputs that were not recorded.
    """

    only: str | None = None
    hold_out: str | None = None
    assume: Sequence[str] = ()


def analysis(verb: str, runs: Sequence[str], model: str, choice: DataOptions | None = None) -> str:
    """A command about a model and runs, with the same choice: ``rigctl diagnose latest --model …``."""
    return command([verb, *runs, "--model", model], choice)


def command(arguments: Sequence[str], choice: DataOptions | None = None) -> str:
    """A command of these words, and the choice of records."""
    chosen = choice or DataOptions()
    words = ["rigctl", *map(_quoted, arguments)]
    for option, value in (("--only", chosen.only), ("--hold-out", chosen.hold_out)):
        if value:
            words += [option, f'"{value}"']
    for text in chosen.assume:
        words += ["--assume", _quoted(text)]
    return " ".join(words)


def page_of(verb: str, runs: Sequence[str], model: str, choice: DataOptions | None = None) -> str:
    """The command that makes the page of what `verb` said of these records: `report` looks at all of them."""
    if choice is not None and (choice.only or choice.hold_out):
        return f"{analysis(verb, runs, model, choice)} -o page.html"
    return analysis("report", runs, model, choice) + " --diagnose" * (verb == "diagnose")


def _quoted(text: str) -> str:
    """An argument as every shell takes it."""
    return text if _PLAIN.fullmatch(text) else f'"{text}"'
