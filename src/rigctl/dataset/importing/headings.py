"""Names of columns as files write them: with a unit in brackets, and units spelt in other ways."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Final

_HEADING: Final = re.compile(r"(?P<name>.*?)\s*(?:\[(?P<unit>[^\[\]]*)\])?")
#: how other programs write units that have another name here
_UNITS: Final[Mapping[str, str]] = {
    "deg C": "degC",
    "Deg C": "degC",
    "degrees C": "degC",
    "Celsius": "degC",
    "sec": "s",
    "seconds": "s",
    "-": "1",
    "none": "1",
}


def split_heading(text: str) -> tuple[str, str | None]:
    """The name and the unit of ``name [unit]``; no unit where there are no brackets, no name for nonsense."""
    match = _HEADING.fullmatch(text.strip())
    if match is None:
        return "", None
    return match["name"], unit_of(match["unit"])


def unit_of(written: object) -> str | None:
    """The unit that a file gives a column, as it is called here; None where it gives none."""
    text = str(written).strip() if written is not None else ""
    return _UNITS.get(text, text) or None
