"""Column names as in files: with a unit beside the name, and with other spellings of units and of time.

Every reader of a file, and the draft of a first family, reads headings here, so that a heading that one
command understands is understood by all.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Final

from rigctl.errors import RigctlError
from rigctl.units import find_unit, is_speed_of_rotation, parse_unit

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

_BRACKETS: Final = re.compile(r"(?P<name>[^\[\]]*?)\s*(?:\[(?P<unit>[^\[\]]*)\])?")
#: other ways to write a unit after a name; accepted only if it is a unit
_BESIDE: Final = (
    re.compile(r"(?P<name>.+?)\s*\((?P<unit>[^()]+)\)"),
    re.compile(r"(?P<name>.+?)\s*\{(?P<unit>[^{}]+)\}"),
    re.compile(r"(?P<name>.+?)(?:\s+/|\s*[,;])\s*(?P<unit>\S+)"),
    re.compile(r"(?P<name>[^\s/]{2,}|[A-Za-z])/(?P<unit>\S+)"),  # 'T/K'; 'm/s' is a unit itself
    re.compile(r"(?P<name>.+?)\s*<(?P<unit>[^<>]+)>"),
    re.compile(r"(?P<name>.+?)\s+in\s+(?P<unit>\S{2,}|[shVWNKm])"),  # 'pressure in A' names a place
)
#: as HOBO loggers write the logger, the sensor and its label after a name, and the zone after a time
_SERIAL: Final = re.compile(r"(?P<name>.+?)\s*\((?:LGR|SEN) S/N:[^()]*?(?:LBL: (?P<label>[^(),]+))?\)")
_ZONED: Final = re.compile(r"(?P<name>(?:Date )?Time), GMT[+-]\d{2}:\d{2}")
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
    "pct": "%",
    "Volt": "V",
    "Volts": "V",
    "volts": "V",
    "VDC": "V",
    "Amp": "A",
    "Amps": "A",
    "RPM": "rpm",
    **dict.fromkeys(("U/min", "Upm", "UPM", "tr/min", "giri/min", "obr/min", "omw/min", "ot/min"), "rpm"),
    "PSI": "psi",
    "BAR": "bar",
    "millis": "ms",
    "milliseconds": "ms",
    "micros": "us",
    "microseconds": "us",
    "minutes": "min",
    "hours": "h",
}
#: readings of a converter or an encoder: units in brackets alone, elsewhere they are words of a name
_COUNTS: Final = frozenset(("ticks", "tick", "raw", "digits", "LSB"))
#: names with the same meaning in every file, ignoring case
SPECIAL: Final = ("time", "record", "date")
#: names of time columns in other programs and languages, as `_key` returns them
_TIMES: Final = frozenset(
    (  # noqa: SIM905
        "time t seconds secs sec millis milliseconds msec micros microseconds elapsed elapsed_time "
        "time_elapsed elapsed_seconds clock clock_time time_of_day timestamp time_stamp datetime date_time "
        "date_and_time relative_time rel_time absolute_time abs_time run_time runtime sample_time "
        "measurement_time rec_time "
        "zeit uhrzeit zeitpunkt zeitstempel datum_zeit datum_uhrzeit messzeit laufzeit sekunden "
        "tiempo hora fecha_hora fecha_y_hora marca_de_tiempo segundos "
        "tempo ora data_ora data_e_ora data_hora secondi temps heure date_heure horodatage secondes "
        "tijd tijdstip datum_tijd tid tidpunkt tidsstempel klokkeslett czas cas aika ido zaman "
        "\u0432\u0440\u0435\u043c\u044f \u65f6\u95f4 \u6642\u9593 \u6642\u523b"
    ).split()
)
#: names of the first column of a chart's data, which is the time if nothing says otherwise
_FIRST_AXES: Final = ("x_value", "x_axis", "x_wert")
#: time columns whose name is a unit of them
_NAMED_UNITS: Final[Mapping[str, str]] = {
    **dict.fromkeys(("seconds", "secs", "sec", "elapsed_seconds", "sekunden", "segundos"), "s"),
    **dict.fromkeys(("secondi", "secondes"), "s"),
    **dict.fromkeys(("millis", "milliseconds", "msec"), "ms"),
    **dict.fromkeys(("micros", "microseconds"), "us"),
}
#: columns that number the rows, as `_key` returns them; one without a name has its number for a name
_COUNTERS: Final = frozenset(
    (  # noqa: SIM905
        "sample samples sample_no sample_number scan scan_number index idx row row_no no nr n k record_no "
        "reading point messung lfd_nr # entry counter seq"
    ).split()
)
#: columns of dates beside a time of day; `data` is a date only beside `ora` or `hora`
_DATES: Final = frozenset(("date", "datum", "fecha", "dato", "dia", "giorno", "jour"))
#: endings that are units, and nothing else that a name may end in: speed_rpm
_ENDINGS: Final = frozenset(
    (  # noqa: SIM905
        "s ms us min sec mm cm um V mV A mA W kW N kN Nm bar mbar Pa kPa MPa psi degC degF K rpm RPM Hz kHz "
        "kg rad deg pct percent lpm"
    ).split()
)
#: columns whose whole name is a unit, which is also kept as their name: rpm
_NAMED_AS_UNIT: Final[Mapping[str, str]] = {
    **dict.fromkeys(("volt", "volts", "vdc"), "V"),
    "amps": "A",
    "rpm": "rpm",
    "mbar": "mbar",
    "kpa": "kPa",
    "degc": "degC",
}
_ENDING: Final = re.compile(r"(?P<name>.*[^\s_])[ _](?P<unit>[A-Za-z%]+)")
#: what ends in A in amperes; otherwise that is a place: 'Channel A', 'pressure A'
_CURRENTS: Final = re.compile(r"(.*(current|strom|courant|corriente|corrente)|curr|amps?)\d*")
#: the same, as the first word: i, ia, iq, i1, imot; but 'In A' and 'it A' are other words
_CURRENT_FIRST: Final = re.compile(r"i(?!n$|t$)([a-z]|mot|arm|rms|dc|bus|bat)?\d*")
#: words in the name of a rotating quantity
_TURNING: Final = ("drehzahl", "umdrehung", "rpm", "rotation", "revolution", "spindle", "shaft", "rotor")
#: Greek letters in names of quantities
_GREEK: Final[Mapping[str, str]] = dict(
    zip(
        "\u03b1\u03b2\u03b3\u03b4\u03b5\u03b7\u03b8\u03ba\u03bb\u03bc\u03bd\u03be\u03c1\u03c3\u03c4\u03c6\u03d5\u03c8\u03c9",
        (  # noqa: SIM905
            "alpha beta gamma delta epsilon eta theta kappa lambda mu nu xi rho sigma tau phi phi psi omega"
        ).split(),
        strict=True,
    )
)
#: two parts of a time of day in a heading, h:min or mm:ss
_CLOCK_UNIT: Final = re.compile(r"[hms]+(in|ec)?:[hms]+(in|ec)?(:s+(ec)?)?", re.IGNORECASE)


def split_heading(text: str) -> tuple[str, str | None]:
    """Split ``name [unit]``; without brackets there is no unit, and an invalid text has no name.

    ``name (unit)``, ``name / unit``, ``name, unit`` and ``name in unit`` are accepted if that is a unit.
    """
    written = " ".join(text.split())
    if serial := _SERIAL.fullmatch(written):  # Temp, \N{DEGREE SIGN}C (LGR S/N: 20717, LBL: oven)
        name, unit = split_heading(serial["name"])
        return serial["label"] or name, unit
    if zoned := _ZONED.fullmatch(written):
        return zoned["name"], None
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
    return "count" if text in _COUNTS else _UNITS.get(text, text) or None


def is_unit(written: str) -> bool:
    """Return whether a text is a unit and cannot be anything else, such as a plain number."""
    text = unit_of(written)
    if written.strip() in _COUNTS:
        return False
    if text is None or text.strip().isdigit():
        return written.strip() == "1"
    return find_unit(text) is not None


def plain_name(written: str) -> str:
    """Return a name without surrounding space; ``Time`` is time in any case."""
    name = written.strip()
    return name.casefold() if name.casefold() in SPECIAL else name


def folded(name: str) -> str:
    """Return a key that spellings of one name share: ``Oil Temperature`` and ``oil_temperature``."""
    return re.sub(r"[\s_-]+", "_", name.strip()).casefold()


def split_ending(name: str, *, is_current: bool = False) -> tuple[str, str | None]:
    """Split ``speed_rpm`` into a name and its unit, None for a name that does not end in a unit.

    ``rpm`` and ``volts`` are a name and a unit at once. A final ``A`` is a place, as in ``pressure_A``,
    unless the name says, or the caller knows (`is_current`), that it is a current.
    """
    if own := _NAMED_AS_UNIT.get(name.strip().casefold()):
        return name, own
    match = _ENDING.fullmatch(name.strip())
    if match is None or match["unit"] not in _ENDINGS:
        return name, None
    if match["unit"] == "A" and not (is_current or _is_current(match["name"])):
        return name, None
    return match["name"], unit_of(match["unit"])


def _is_current(name: str) -> bool:
    words = folded(name).split("_")
    return bool(_CURRENT_FIRST.fullmatch(words[0])) or any(_CURRENTS.fullmatch(word) for word in words)


def counts_rows(name: str, values: NDArray[np.float64]) -> bool:
    """Return whether a column numbers the rows of its file, by its name and by its values."""
    import numpy as np

    known = _key(name) in _COUNTERS or name.isdigit()
    return known and len(values) > 1 and values[0] in (0.0, 1.0) and bool(np.all(np.diff(values) == 1.0))


def time_unit(name: str, unit: str | None) -> tuple[bool, str | None]:
    """Return whether a column holds the times of its rows, by its name, and the unit in the name.

    A name that may mean something else, such as the plural `temps`, is a time unless its unit says otherwise.
    """
    plain, ending = split_ending(name) if unit is None else (name, None)
    if unit is not None and not _is_of_time(unit):
        return False, None
    if ending is not None and not _is_of_time(ending):
        return False, None
    if unit is not None and split_ending(name)[1] == unit:  # Zeit_s [s] says its unit twice
        plain = split_ending(name)[0]
    key = _key(plain)
    if key not in _TIMES or (name.strip() == "T" and unit is None):
        return False, None
    return True, ending or (_NAMED_UNITS.get(key) if unit is None else None)


def counts_turns(name: str, unit: str) -> bool:
    """Return whether a count per minute is one of turns, by its name: ``Drehzahl [1/min]`` is in rpm."""
    try:
        parsed = parse_unit(unit)
    except RigctlError:
        return False
    minute = parse_unit("1/min")
    per_minute = parsed.dimension == minute.dimension and parsed.factor == minute.factor
    turning = any(word in name.casefold() for word in _TURNING)
    return per_minute and turning and not is_speed_of_rotation(unit)


def is_first_axis(names: Sequence[str], unit: str | None) -> bool:
    """Return whether the first of all columns is the time as the horizontal axis of a chart: ``X_Value``.

    Beside a ``y`` or a ``z`` it is a position or the abscissa of a scan, unless its unit is one of time.
    """
    keys = [_key(name) for name in names]
    if keys[0] not in _FIRST_AXES or (unit is not None and not _is_of_time(unit)):
        return False
    others = {f"{letter}{keys[0][1:]}" for letter in "yz"}
    return unit is not None or others.isdisjoint(keys)


def is_date(name: str, beside: str) -> bool:
    """Return whether a column holds the dates of the times of day in the column `beside`, by its name."""
    key = _key(name)
    return key in _DATES or (key == "data" and _key(beside) in ("ora", "hora"))


def _is_of_time(unit: str) -> bool:
    if _CLOCK_UNIT.fullmatch(unit.replace(" ", "")):
        return True
    known = find_unit(unit)
    return known is not None and known.dimension == parse_unit("s").dimension


def _key(name: str) -> str:
    """Return a key of a name without case and accents."""
    plain = unicodedata.normalize("NFKD", folded(name))
    return "".join(sign for sign in plain if not unicodedata.combining(sign)).strip("_.: ")


def identifier(text: str) -> str:
    """Return a name as a formula can use it: ``Motor Speed`` is ``motor_speed``; empty without letters."""
    plain = unicodedata.normalize("NFKD", text.strip().casefold())
    letters = "".join(_GREEK.get(sign, sign) for sign in plain if not unicodedata.combining(sign))
    return re.sub(r"[^a-z0-9]+", "_", letters).strip("_")
