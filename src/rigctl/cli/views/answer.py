"""How an answer is printed: the verdict, and a line for each fact; ``-v`` shows the evidence."""

from __future__ import annotations

from collections.abc import Sequence

from rich.markup import escape

from rigctl.cli.tables import console
from rigctl.report.answer import Answer
from rigctl.wording import number_of

_COLOURS = {"good": "green", "warn": "yellow", "bad": "red", "open": "bright_black"}
_WIDTH = 11


def show_answer(answer: Answer, *, title: str = "", more: Sequence[str] = ()) -> None:
    """Print the title and the sentence, a line for each fact, and what ``-v`` would add.

    Parameters
    ----------
    title: replaces that of the answer; with "-" only the sentence is printed.
    more: what was left out, e.g. ``4 notes on the data``.
    """
    out, colour = console(), _COLOURS[answer.tone]
    show_first(answer.first)
    head = title or answer.title
    if head == "-" or answer.sentence.startswith(head):
        out.print(f"[bold {colour}]{escape(answer.sentence)}[/]", soft_wrap=True)
    else:
        out.print(f"[bold {colour}]{escape(head)}[/]: {escape(answer.sentence)}.", soft_wrap=True)
    for name, text in answer.facts:
        out.print(f"  [dim]{escape(name):<{_WIDTH}}[/] {escape(text)}", soft_wrap=True)
    if more:
        out.print(f"  [dim]{'-v shows':<{_WIDTH}} {escape(', '.join(more))}[/]", soft_wrap=True)


def show_first(sentences: Sequence[str]) -> None:
    """Print what has to be known before the answer."""
    for sentence in sentences:
        console().print(f"[bold yellow]{escape(sentence)}.[/]", soft_wrap=True)


def counted(number: int, noun: str, nouns: str | None = None) -> list[str]:
    """``["4 notes"]``; nothing of none."""
    return [number_of(number, noun, nouns)] if number else []
