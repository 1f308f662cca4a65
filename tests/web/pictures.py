"""What the pictures of the documentation show, told from the page itself.

``python tools/workbench_pictures.py`` writes into each picture what could be read of the page when it was
taken: headings, buttons, labels. The tests read the page again, so that a picture of a page that has changed
since is found without a look at pixels.
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
    """Headings, buttons and labels that are seen, without numbers and what belongs to the data alone."""
    found: list[str] = place.evaluate(_READ)
    plain = (re.sub(r"\s+", " ", re.sub(r"[\d.]+", "", text)).strip() for text in found)
    return sorted({text for text in plain if text})


def outline_of_picture(name: str) -> list[str]:
    """What was on the page when the picture was taken: a ``tEXt`` chunk of the PNG."""
    data, at = (FOLDER / f"{name}.png").read_bytes(), 8
    while at < len(data):
        length, kind = struct.unpack_from(">I4s", data, at)
        keyword, _, text = data[at + 8 : at + 8 + length].partition(b"\0")
        if kind == b"tEXt" and keyword == FIELD.encode():
            written: list[str] = json.loads(text)
            return written
        at += 12 + length
    return []
