"""The style sheet of the page and the plots draw a series in the same colour."""

from __future__ import annotations

import re
from pathlib import Path

from rigctl.report import colours

ASSETS = Path(colours.__file__).parent / "assets"


def test_the_style_sheet_has_the_colours_of_the_plots() -> None:
    text = (ASSETS / "page.css").read_text("utf-8")
    named = re.findall(r"--series-(\d): (#[0-9a-f]{6});", text)
    assert [colour for _, colour in sorted(named)] == list(colours.SERIES)


def test_the_error_maps_of_the_page_use_the_colours_of_the_first_two_series() -> None:
    light = (ASSETS / "page.css").read_text("utf-8").partition("@media")[0]
    found = re.findall(r"--(?:below|above): (\d+), (\d+), (\d+);", light)
    assert ["#" + "".join(f"{int(part):02x}" for part in one) for one in found] == list(colours.SERIES[:2])
