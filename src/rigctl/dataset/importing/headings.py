"""Names of columns as files write them: with a unit beside the name, and units spelt in other ways."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Final

from rigctl.errors import RigctlError
from rigctl.units import parse_unit

_BRACKETS: Final = re.compile(r"(?P<name>[^\[\]]*?)\s*(?:\[(?P<unit>[^\[\]]*)\])?")
#: other ways of writing a unit behind a name; taken for one only where it is a unit
_BESIDE: Final = (
    re.compile(r"(?P<name>.+?)\s*\((?P<unit>[^()]+)\)"),
    re.compile(r"(?P<name>.+?)\s*\{(?P<unit>[^{}]+)\}"),
    re.compile(r"(?P<name>.+?)(?:\s+/|\s*[,;])\s*(?P<unit>\S+)"),
    re.compile(r"(?P<name>.+?)\s+in\s+(?P<unit>\S{2,})"),  # 'pressure in A' is a place
)
#: how other programs write units that have another name here
_UNITS: Final[Mapping[str, str]] = {
    "deg C": "degC",
    "Deg C": "degC",
    "deg. C": "degC",
    "degrees C": "degC",
    "Celsius": "degC",
    "\N{DEGREE CELSIUS}": "degC",
    "deg F": "degF",
    "Fahrenheit": "degF",
    "sec": "s",
    "secs": "s",
    "seconds": "s",
    "Sek": "s",
    "msec": "ms",
    "usec": "us",
    "hr": "h",
    "hrs": "h",
    "L/min": "l/min",
    "lpm": "l/min",
    "-": "1",
    "none": "1",
    "percent": "%",
}
#: names under which a column means the same in every file, whatever the case
SPECIAL: Final = ("time", "record", "date")


def split_heading(text: str) -> tuple[str, str | None]:
    """The name and the unit of ``name [unit]``; no unit where there are no brackets, no name for nonsense.

    ``name (unit)``, ``name / unit``, ``name, unit`` and ``name in unit`` are read where that is a unit.
    """
    written = " ".join(text.split())
    match = _BRACKETS.fullmatch(written)
    if match is None:
        return "", None
    if match["unit"] is not None:
        return match["name"], unit_of(match["unit"])
    for form in _BESIDE:
        found = form.fullmatch(written)
        if found and is_unit(found["unit"]):
            return found["name"], unit_of(found["unit"])
    return match["name"], None


def unit_of(written: object) -> str | None:
    """The unit that a file gives a column, as it is called here; None where it gives none."""
    text = str(written).strip() if written is not None else ""
    return _UNITS.get(text, text) or None


def is_unit(written: str) -> bool:
    """Whether a text is a unit and cannot be something else: no bare number."""
    text = unit_of(written)
    if text is None or text.strip().isdigit():
        return written.strip() == "1"
    try:
        parse_unit(text)
    except RigctlError:
        return False
    return True


def plain_name(written: str) -> str:
    """A name without space around it; ``Time`` is time, whatever the case."""
    name = written.strip()
    return name.casefold() if name.casefold() in SPECIAL else name


def folded(name: str) -> str:
    """What two spellings of one name have in common: ``Oil Temperature`` and ``oil_temperature``."""
    return re.sub(r"[\s_-]+", "_", name.strip()).casefold()
