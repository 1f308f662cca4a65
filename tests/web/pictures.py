"""The content of the documentation's pictures, read from the page itself.

``python tools/workbench_pictures.py`` writes the headings, buttons and labels of the page into each picture.
The tests read the page again, so that an outdated picture is found without comparing pixels.
"""

from __future__ import annotations

import json
import re
import struct
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from playwright.sync_api import Locator

FOLDER = Path(__file__).parents[2] / "docs" / "tutorial"
#: the text field of the PNG
FIELD = "outline"
_READ = """root => {
  const texts = "h1, h2, h3, button, label, summary, legend, figcaption, caption, th";
  const ofTheData = ".ranking, .group, .map, .effects, .figures, .record, details details";
  return [...root.querySelectorAll(texts)]
    .filter(one => one.checkVisibility() && !one.closest(ofTheData))
    .map(one => one.textContent);
}"""


def outline(place: Locator) -> list[str]:
    """Visible headings, buttons and labels, without numbers and text that depends only on the data."""
    found: list[str] = place.evaluate(_READ)
    plain = (re.sub(r"\s+", " ", re.sub(r"[\d.]+", "", text)).strip() for text in found)
    return sorted({text for text in plain if text})


def outline_of_picture(name: str) -> list[str]:
    """The content of the page when the picture was taken, from a ``tEXt`` chunk of the PNG."""
    data, at = (FOLDER / f"{name}.png").read_bytes(), 8
    while at < len(data):
        length, kind = struct.unpack_from(">I4s", data, at)
        keyword, _, text = data[at + 8 : at + 8 + length].partition(b"\0")
        if kind == b"tEXt" and keyword == FIELD.encode():
            written: list[str] = json.loads(text)
            return written
        at += 12 + length
    return []
