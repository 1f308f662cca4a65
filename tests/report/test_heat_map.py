"""Heat maps: an HTML table with escaped text, and an image."""

from __future__ import annotations

import math
from pathlib import Path

from rigctl.answers.blocks import Bar, Bars
from rigctl.report.blocks import page_blocks
from rigctl.report.heat_map import HeatMap, heat_map_table, write_heat_map

MAP = HeatMap(
    id="m",
    caption="<script>",
    row_title="oil",
    column_title="supply",
    rows=("20", "<b>"),
    columns=("20", "50"),
    values=((0.9, -4.0), (math.nan, 8.0)),
    strong=((False, True), (False, True)),
    limit=4.0,
)


def test_a_map_is_a_table_whose_texts_are_escaped() -> None:
    html = str(heat_map_table(MAP))
    assert "<script>" not in html
    assert "&lt;script&gt;" in html
    assert "&lt;b&gt;" in html
    assert "+8.0 *" in html
    assert "−4.0 *" in html


def test_equal_maps_give_identical_images(tmp_path: Path) -> None:
    first = write_heat_map(MAP, tmp_path, "png").read_bytes()
    assert first.startswith(b"\x89PNG")
    assert write_heat_map(MAP, tmp_path, "png").read_bytes() == first


def test_a_bar_is_limited_to_its_track_and_its_label_is_escaped() -> None:
    html = str(page_blocks([Bars("t", (Bar("<i>", 1.7, "170 %"), Bar("b", -1.0, "")))]))
    assert "&lt;i&gt;" in html
    assert "width: 100.0%" in html
    assert "width: 0.0%" in html
