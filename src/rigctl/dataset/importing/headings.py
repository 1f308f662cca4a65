"""Column names as in files: with a unit beside the name, and with other spellings of units."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Final

from rigctl.errors import RigctlError
from rigctl.units import parse_unit

_BRACKETS: Final = re.compile(r"(?P<name>[^\[\]]*?)\s*(?:\[(?P<unit>[^\[\]]*)\])?")
#: other ways to write a unit after a name; accepted only if it is a unit
_BESIDE: Final = (
    re.compile(r"(?P<name>.+?)\s*\((?P<unit>[^()]+)\)"),
    re.compile(r"(?P<name>.+?)\s*\{(?P<unit>[^{}]+)\}"),
    re.compile(r"(?P<name>.+?)(?:\s+/|\s*[,;])\s*(?P<unit>\S+)"),
    re.compile(r"(?P<name>.+?)\s+in\s+(?P<unit>\S{2,})"),  # 'pressure in A' names a place
)
#: other programs' names of units
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
#: names with the same meaning in every file, ignoring case
SPECIAL: Final = ("time", "record", "date")
#: names of time columns in other programs, case-folded
TIMES: Final = frozenset(
    (  # noqa: SIM905
        "time t time_s t_s seconds elapsed elapsed_time clock clock_time time_of_day timestamp time_stamp "
        "datetime date_time zeit uhrzeit zeitpunkt zeitstempel datum_zeit"
    ).split()
)


def split_heading(text: str) -> tuple[str, str | None]:
    """Split ``name [unit]``; without brackets there is no unit, and an invalid text has no name.

    ``name (unit)``, ``name / unit``, ``name, unit`` and ``name in unit`` are accepted if that is a unit.
    """
    written = " ".join(text.split())
    match = _BRACKETS.fullmatch(written)
    if match is None:
        return "", None
    if match["unit"] is not None:
        return match["name"], unit_of(match["unit"])
    for form in _BESIDE:
        parts = form.fullmatch(written)
        if parts and is_unit(parts["unit"]):
            return parts["name"], unit_of(parts["unit"])
    return match["name"], None


def unit_of(written: object) -> str | None:
    """Return the unit of a column under our name; None if the file has none."""
    text = str(written).strip() if written is not None else ""
    return _UNITS.get(text, text) or None


def is_unit(written: str) -> bool:
    """Return whether a text is a unit and cannot be anything else, such as a plain number."""
    text = unit_of(written)
    if text is None or text.strip().isdigit():
        return written.strip() == "1"
    try:
        parse_unit(text)
    except RigctlError:
        return False
    return True


def plain_name(written: str) -> str:
    """Return a name without surrounding space; ``Time`` is time in any case."""
    name = written.strip()
    return name.casefold() if name.casefold() in SPECIAL else name


def folded(name: str) -> str:
    """Return a key that spellings of one name share: ``Oil Temperature`` and ``oil_temperature``."""
    return re.sub(r"[\s_-]+", "_", name.strip()).casefold()
