"""Every kind of block is rendered by a terminal and by a page, with the same words."""

from __future__ import annotations

import re
from typing import get_args

import pytest

from rigctl.answers.blocks import (
    Bar,
    Bars,
    Block,
    Column,
    Details,
    Figure,
    Next,
    Note,
    Point,
    Points,
    Sentence,
    Table,
)
from rigctl.cli.blocks import show
from rigctl.report.blocks import page_blocks

TABLE = Table(
    (
        Column("name", "effect"),
        Column("share", "probability", lambda share: f"{100 * share:.0f} %", full=1.0),
        Column("z", "sigma", "{:.1f}".format, beyond=3.0),
    ),
    (
        {"name": "leaks"},
        {"name": "rod_leakage", "share": 0.5, "z": 4.0},
        {"name": "lag", "share": 0.1, "z": None},
    ),
    strong=frozenset({1}),
)
BLOCKS: tuple[Block, ...] = (
    Sentence("oil <leaks>", "warn", "missing"),
    Note("read in steps"),
    Points("evidence", (Point("it stands out", "+"), Point("it is absorbed", "-"))),
    TABLE,
    Bars("shares", (Bar("noise", 0.5, "50 %"),)),
    Figure("plot", "the worst record"),
    Details("more", (Note("folded"),)),
    Next("rigctl compare latest", "compares"),
)


def test_a_terminal_shows_every_block_but_a_plot(capsys: pytest.CaptureFixture[str]) -> None:
    assert {type(one) for one in BLOCKS} == set(get_args(Block))
    show(BLOCKS)
    told = capsys.readouterr().out
    for words in (
        "missing: oil <leaks>.",
        "read in steps",
        "+ it stands out",
        "- it is absorbed",
        "rod_leakage",
        "50 %",
        "folded",
        "Next: rigctl compare latest",
    ):
        assert words in told
    assert "the worst record" not in told


def test_a_page_shows_every_block_escaped_with_names_as_words() -> None:
    drawn = str(page_blocks(BLOCKS, {"plot": page_blocks([Note("drawn")])}))
    for words in (
        "Oil &lt;leaks&gt;.",
        "It stands out.",
        "rod leakage",
        'scope="rowgroup"',
        "50 %",
        "The worst record",
        "Drawn.",
        "Folded.",
        "<code>rigctl compare latest</code>",
    ):
        assert words in drawn
    assert "<leaks>" not in drawn


def test_code_is_shown_as_it_is_written_in_files(capsys: pytest.CaptureFixture[str]) -> None:
    block = Points("formula 1", (Point("fits"),), code="size*exp(-x^2)*v/(1 m/s) < 2")
    assert "<h3>Formula 1: <code>size*exp(-x^2)*v/(1 m/s) &lt; 2</code></h3>" in page_blocks((block,), {})
    show((block,))
    assert "formula 1: size*exp(-x^2)*v/(1 m/s) < 2" in capsys.readouterr().out


def test_a_figure_that_was_not_drawn_is_left_out_of_a_page() -> None:
    assert page_blocks([Figure("plot", "the worst record")]) == ""


def test_a_missing_value_is_empty_and_a_large_one_is_marked() -> None:
    z = TABLE.columns[2]
    heading, leak, lag = TABLE.rows
    assert TABLE.heads(heading)
    assert not TABLE.heads(leak)
    assert (z.text(leak), z.text(lag)) == ("4.0", "")
    assert (z.marked(leak), z.marked(lag)) == (True, False)


def test_what_has_nothing_below_its_title_is_left_out(capsys: pytest.CaptureFixture[str]) -> None:
    empty: tuple[Block, ...] = (
        Points("evidence", ()),
        Table((Column("name", "effect"),), (), "the ranking"),
        Bars("shares", ()),
        Details("more", (Points("evidence", ()),)),
    )
    show(empty)
    assert capsys.readouterr().out == ""
    assert page_blocks(empty) == ""


def test_a_page_prints_units_as_symbols_and_a_terminal_as_in_files(
    capsys: pytest.CaptureFixture[str],
) -> None:
    columns = (
        Column("name", "bore_width [um]"),
        Column("share", "share [1]"),
        Column("level", "level [percent]"),
        Column("area", "area [um^2]"),
        Column("unit", "unit", words=True, unit=True),
    )
    rows = tuple({"name": unit, "unit": unit} for unit in ("um", "percent", "1", "N*s/m"))
    blocks: list[Block] = [Table(columns, rows), Bars("gap, error [um]; bars without", (Bar("a", 1.0, ""),))]
    drawn = str(page_blocks(blocks))
    headings = re.findall(r'<th scope="col"[^>]*>(.*?)</th>', drawn)
    assert headings == ["bore width [µm]", "share", "level [%]", "area [µm²]", "unit"]
    assert re.findall(r'<td class="words">(.*?)</td>', drawn) == ["µm", "%", "", "N·s/m"]
    assert "Gap, error [µm]; bars without</caption>" in drawn
    show(blocks)
    told = capsys.readouterr().out
    assert all(f"[{unit}]" in told for unit in ("um", "1", "percent", "um^2"))
    ends = {line.split()[-1] for line in told.splitlines() if line.split()}
    assert ends >= {"um", "percent", "1", "N*s/m"}
