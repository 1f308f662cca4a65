"""The next command: the last line of an answer."""

from __future__ import annotations

from collections.abc import Sequence

from rich.markup import escape

from rigctl.cli.tables import console
from rigctl.command_line import DataOptions, analysis


def show_next(command: str, why: str) -> None:
    """Show the command, and below it what it does."""
    console().print(f"\nNext: [bold]{escape(command)}[/]\n  {escape(why)}", soft_wrap=True)


def page_of(verb: str, runs: Sequence[str], model: str, choice: DataOptions | None = None, *own: str) -> str:
    """The command that makes the page of `verb` for the selected records, with its `own` options.

    `report`, which is shorter, uses all records and has none of these options.
    """
    if own or (choice is not None and (choice.only or choice.hold_out)):
        return f"{analysis(verb, runs, model, choice, *own)} -o page.html"
    return analysis("report", runs, model, choice) + " --diagnose" * (verb == "diagnose")
