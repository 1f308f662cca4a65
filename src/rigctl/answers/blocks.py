"""What an answer consists of: every result is worded once, as blocks, and each place that shows it renders
blocks.

A module of `rigctl.answers` takes a result of the analysis and returns blocks; a terminal, a page and a
notebook render the same blocks, so that they cannot say different things. An `Answer` is what a reader sees
first: a title with its tone, one sentence, a few facts; the evidence is the blocks below it, on demand.

A text has no mark-up and no full stop at its end; units and names are those of the files (``degC``,
``valve_leakage``). What a page prints instead (°C, valve leakage) is the matter of its renderer.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

from rigctl.wording import number_of

#: good if nothing is wrong, warn if something is missing, bad if the model fails, open if it is not decided
Tone = Literal["good", "warn", "bad", "open"]


@dataclass(frozen=True)
class Sentence:
    """A statement.

    Attributes
    ----------
    tone: how good or bad the news is; None for a plain statement.
    head: a few words before it; with a tone they carry it.
    main: whether it is what the reader came for.
    """

    text: str
    tone: Tone | None = None
    head: str = ""
    main: bool = False


@dataclass(frozen=True)
class Note:
    """A remark on how the data were taken or how to read what is shown."""

    text: str


@dataclass(frozen=True)
class Point:
    """One entry of a list; ``+`` marks what speaks for it, ``-`` what speaks against it, ``!`` what deserves
    attention."""

    text: str
    mark: Literal["", "+", "-", "!"] = ""


@dataclass(frozen=True)
class Points:
    """A list with a title, which may be empty.

    `titled` is False if its entries say by themselves what they are: only a page has room for the title.
    `code` stands after the title as it is written in files, to be copied.
    """

    title: str
    points: tuple[Point, ...]
    titled: bool = True
    code: str = ""

    @classmethod
    def of(cls, title: str, texts: Sequence[str], *, titled: bool = True) -> Points:
        """A list without marks."""
        return cls(title, tuple(map(Point, texts)), titled)


def plain_text(value: Any) -> str:
    """A cell that is text already."""
    return str(value)


@dataclass(frozen=True)
class Column:
    """A column of a table.

    Attributes
    ----------
    key: of its values in the rows.
    heading: with the unit, if all rows have the same.
    form: makes text of a value; a missing value (None) is empty.
    full: the value of a full bar, which is then drawn beside the text; 0.0 for none.
    words: whether it holds words, which are aligned left and may wrap; numbers are aligned right.
    beyond: the size from which a number is marked; None for never.
    unit: whether it holds units as they are in files.
    """

    key: str
    heading: str
    form: Callable[[Any], str] = plain_text
    full: float = 0.0
    words: bool = False
    beyond: float | None = None
    unit: bool = False

    def text(self, row: Mapping[str, Any]) -> str:
        """The cell of a row."""
        value = row.get(self.key)
        return "" if value is None else self.form(value)

    def marked(self, row: Mapping[str, Any]) -> bool:
        """Whether the value is beyond what is usual."""
        value = row.get(self.key)
        return self.beyond is not None and value is not None and abs(value) > self.beyond


@dataclass(frozen=True)
class Table:
    """Rows of values, the first column naming each row.

    Attributes
    ----------
    rows: values by the keys of the columns; a row with nothing but the first is a heading of those below it.
    strong: the numbers of rows that stand out.
    """

    columns: tuple[Column, ...]
    rows: tuple[Mapping[str, Any], ...]
    caption: str = ""
    strong: frozenset[int] = frozenset()

    def heads(self, row: Mapping[str, Any]) -> bool:
        """Whether a row is a heading of those below it."""
        return set(row) == {self.columns[0].key} and len(self.columns) > 1


@dataclass(frozen=True)
class Bar:
    """One bar: its label, its length as a share of the longest, the text beside it, and a note.

    Attributes
    ----------
    parts: bars of which it consists, one behind another.
    """

    label: str
    share: float
    text: str
    note: str = ""
    colour: int = 0
    parts: tuple[Bar, ...] = ()

    @property
    def percent(self) -> str:
        """The length in CSS."""
        return f"{100.0 * min(max(self.share, 0.0), 1.0):.1f}%"


@dataclass(frozen=True)
class Bars:
    """Bars of shares or sizes below a title."""

    title: str
    bars: tuple[Bar, ...]


@dataclass(frozen=True)
class Sparkline:
    """A curve in a terminal, where a page has a plot.

    Attributes
    ----------
    values: at equal distances.
    low, high: ends of its axis; None for its lowest and highest value.
    ends: texts beside the top and the bottom of the axis.
    name: behind the top.
    lines, width: its size in characters.
    """

    values: tuple[float, ...]
    low: float | None = None
    high: float | None = None
    ends: tuple[str, str] = ("", "")
    name: str = ""
    lines: int = 6
    width: int = 56


@dataclass(frozen=True)
class Figure:
    """Where a page draws the plot `key`; a terminal shows only the `curve`, if there is one."""

    key: str
    caption: str
    note: str = ""
    curve: Sparkline | None = None


@dataclass(frozen=True)
class Details:
    """Blocks that only some readers want."""

    title: str
    blocks: tuple[Block, ...]


@dataclass(frozen=True)
class Next:
    """The next command, and what it does."""

    command: str
    why: str


Block: TypeAlias = Sentence | Note | Points | Table | Bars | Figure | Details | Next


def is_empty(block: Block) -> bool:
    """Whether nothing would be below the title of a block, which is then left out."""
    match block:
        case Points():
            return not block.points
        case Table():
            return not block.rows
        case Bars():
            return not block.bars
        case Details():
            return all(map(is_empty, block.blocks))
        case _:
            return False


@dataclass(frozen=True)
class Answer:
    """The result for a reader who has a minute; the evidence for it is other blocks.

    Attributes
    ----------
    title: the verdict in a few words.
    sentence: the verdict in a plain sentence, without a full stop; `headed` if it needs the title before it.
    facts: headings and texts, the most important first.
    first: what comes before the verdict: what has to be known to trust it.
    remarks: what belongs to it at any length.
    folded: further remarks, for which only a page has room.
    more: what its evidence adds, each in a few words: ``4 notes on the data``.
    """

    tone: Tone
    title: str
    sentence: str
    facts: tuple[tuple[str, str], ...] = ()
    first: tuple[str, ...] = ()
    remarks: tuple[Block, ...] = ()
    folded: tuple[Block, ...] = ()
    more: tuple[str, ...] = ()
    headed: bool = True


def nonempty(facts: Sequence[tuple[str, str]]) -> tuple[tuple[str, str], ...]:
    """The facts that are not empty."""
    return tuple((head, text) for head, text in facts if text)


def counted(number: int, noun: str, nouns: str | None = None) -> list[str]:
    """``["4 notes"]``; nothing of none."""
    return [number_of(number, noun, nouns)] if number else []
