"""How the blocks of an answer are printed on a terminal.

In: blocks of `rigctl.answers`, whose words, digits and marks are settled. Out: lines on stdout, by Rich.
This module knows kinds of blocks and no result, as does its counterpart for pages,
`rigctl.report.blocks`: what both show is worded once, and cannot differ. Here are only colours, widths
and the characters for bars and curves; a `Figure` without a curve prints nothing, because a terminal
draws no plots.

Lines are left to the terminal to wrap: what is copied from it, such as a path, has no line breaks. Every
text is escaped: a name with brackets is no markup.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from rich.console import Console
from rich.markup import escape

from rigctl.answers.blocks import (
    Answer,
    Bars,
    Block,
    Column,
    Details,
    Next,
    Note,
    Points,
    Sentence,
    Sparkline,
    Table,
    is_empty,
)
from rigctl.cli.next_command import show_next
from rigctl.cli.tables import console, table
from rigctl.cli.terminal_bars import draw_bar
from rigctl.report.braille import draw_curve

_COLOURS = {"good": "green", "warn": "yellow", "bad": "red", "open": "bright_black", None: ""}
_MARKS = {"+": "[green]+[/] ", "-": "[red]-[/] ", "!": "[yellow]![/] ", "": ""}
#: characters of the heading of a fact, of a full bar in a table and by itself, and beside an axis
_WIDTH, _BAR, _LONG_BAR, _AXIS = 11, 16, 40, 9


def show_answer(answer: Answer, evidence: Sequence[Block] = ()) -> None:
    """Print the verdict with a line for each fact, and its evidence, or what ``-v`` would add."""
    for sentence in answer.first:
        show([Sentence(sentence, "warn", main=True)])
    head = answer.title if answer.headed else ""
    show([Sentence(answer.sentence, answer.tone, head, main=True)])
    for name, text in answer.facts:
        _print(console(), f"  [dim]{escape(name):<{_WIDTH}}[/] {escape(text)}")
    if answer.more and not evidence:
        _print(console(), f"  [dim]{'-v shows':<{_WIDTH}} {escape(', '.join(answer.more))}[/]")
    show(evidence)
    show(answer.remarks)


def show(blocks: Iterable[Block], to: Console | None = None) -> None:
    """Print the blocks one below another, on stdout or `to` another console."""
    out = to or console()
    for block in blocks:
        if is_empty(block):
            continue
        if isinstance(block, Details):
            show(block.blocks, out)
        elif isinstance(block, Next):
            show_next(block.command, block.why, out)
        elif isinstance(block, Note):
            _print(out, f"  [dim]{escape(block.text)}[/]")
        elif isinstance(block, Sentence):
            _show_sentence(out, block)
        elif isinstance(block, Points):
            _show_points(out, block)
        elif isinstance(block, Table):
            _show_table(out, block)
        elif isinstance(block, Bars):
            _show_bars(out, block)
        elif block.curve is not None:
            _show_curve(out, block.caption, block.curve)


def _print(out: Console, line: str) -> None:
    out.print(line, soft_wrap=True)


def _show_sentence(out: Console, one: Sentence) -> None:
    colour = _COLOURS[one.tone]
    bold = f"bold {colour}".strip() if one.main else colour
    indent = "" if one.main else "  "
    text = escape(one.text)
    if one.head:
        _print(out, f"{indent}{_styled(escape(one.head), bold or 'bold')}: {text}.")
    else:
        _print(out, f"{indent}{_styled(f'{text}.', bold)}")


def _styled(text: str, style: str) -> str:
    return f"[{style}]{text}[/]" if style else text


def _show_points(out: Console, block: Points) -> None:
    if block.title and block.titled:
        title = f"{block.title}: {block.code}" if block.code else block.title
        _print(out, f"  [bold]{escape(title)}[/]")
    for point in block.points:
        _print(out, f"  {_MARKS[point.mark]}{escape(point.text)}")


def _show_bars(out: Console, block: Bars) -> None:
    """The notes beside bars are left out: lines would be too long."""
    _print(out, f"  [bold]{escape(block.title)}[/]")
    width = max(len(bar.label) for bar in block.bars)
    for bar in block.bars:
        drawn = draw_bar(bar.share, 1.0, width=_LONG_BAR)
        _print(out, f"  {escape(bar.label):<{width}}  [cyan]{drawn}[/] {escape(bar.text)}")


def _show_curve(out: Console, caption: str, curve: Sparkline) -> None:
    """A curve in Braille characters below its caption; a terminal draws no other plots."""
    low = min(curve.values) if curve.low is None else curve.low
    high = max(curve.values) if curve.high is None else curve.high
    lines = draw_curve(curve.values, width=curve.width, height=curve.lines, low=low, high=high)
    if caption:
        _print(out, f"  [bold]{escape(caption)}[/]")
    for number, line in enumerate(lines):
        # texts stand at the first and the last line only: the ends of the axis
        end = curve.ends[0] if number == 0 else curve.ends[1] if number == len(lines) - 1 else ""
        axis = f"{escape(end):>{_AXIS}} │" if any(curve.ends) else "  "
        _print(
            out, f"  {axis}[cyan]{line}[/]" + (f"  {escape(curve.name)}" if curve.name and not number else "")
        )


def _show_table(out: Console, block: Table) -> None:
    """A bar has a column of its own before that of its text."""
    if block.caption:
        _print(out, f"  [bold]{escape(block.caption)}[/]")
    grid = table()
    for number, column in enumerate(block.columns):
        grid.add_column(escape(column.heading), overflow="fold")
        if column.full:
            grid.add_column("", overflow="fold")
        if number and not column.words:
            grid.columns[-1].justify = "right"
    for number, row in enumerate(block.rows):
        if block.heads(row):
            grid.add_row(f"[dim]{escape(block.columns[0].text(row))}[/]")
            continue
        first, *rest = (cell for column in block.columns for cell in _cells(column, row))
        grid.add_row(f"[bold]{first}[/]" if number in block.strong else first, *rest)
    out.print(grid)


def _cells(column: Column, row: Mapping[str, Any]) -> list[str]:
    text = escape(column.text(row))
    if column.marked(row):
        text = f"[bold red]{text}[/]"
    if not column.full:
        return [text]
    return [f"[cyan]{draw_bar(row.get(column.key) or 0.0, column.full, width=_BAR)}[/]", text]
