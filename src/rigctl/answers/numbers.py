"""Numbers, units and times as a page prints them: true minus signs, °C and mm², no needless digits.

In: values, or texts of answers in the notation of files. Out: text for a page. Sentences are converted at
the very end, by the renderer, so that before it every name and unit can be copied back into a file or a
command.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from datetime import datetime

from rigctl.units import significant
from rigctl.wording import noun

MISSING = "–"
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_WORDS = {"degC": "°C", "degF": "°F", "1": "", "percent": "%", "um": "µm", "uPa": "µPa"}
_POWER = re.compile(r"\s*(?:\^|\*\*)\s*(-?\d+)")
_EXPONENT = re.compile(r"((?<![\w.])\d(?:\.\d+)?|(?<=\d)\))e([+-]?\d+)\b")
#: a name in snake case that is not part of a file's name
_UNDERSCORE = re.compile(r"(?<![\w./@-])[a-z][a-z0-9]*(?:_[a-z0-9]+)+(?![\w/@-]|\.\w)")
#: a title, the unit at its end, and a remark
_WITH_UNIT = re.compile(r"(.*?)\s*\[([^\[\]]*)\](;.*)?")
_NAME = re.compile(r"[^\W\d]\w*|(?<!\d)1(?!\d)")


def symbol(unit: str) -> str:
    """A unit as printed: ``degC`` is °C, ``mm^2`` is mm², ``N*s/m`` is N·s/m, ``1`` is empty."""
    if unit == "1":
        return ""
    text = _NAME.sub(lambda match: _WORDS.get(match.group(), match.group()) or "1", unit)
    text = _POWER.sub(lambda match: match.group(1).translate(_SUPERSCRIPT), text)
    return text.replace("*", "·")


def prose(text: str) -> str:
    """A sentence with units and numbers as printed: °C for degC, m³ for m^3, 6.8·10⁻¹⁵, −3."""
    text = re.sub(r"\bdeg([CF])\b", r"°\1", text)
    text = _EXPONENT.sub(lambda match: _scientific(match.group(1), match.group(2)), text)
    text = re.sub(r"(?<=[^\W\d_])\^(-?\d+)", lambda match: match.group(1).translate(_SUPERSCRIPT), text)
    text = re.sub(r"(?<=[^\W\d_])\*(?=[^\W\d_])", "·", text)
    return re.sub(r"(?<![\w.)-])-(?=\d)", "−", text)


def words(text: str) -> str:
    """A sentence as by `prose`, with names as words: valve leakage for valve_leakage, but not file names."""
    return prose(_UNDERSCORE.sub(lambda match: match.group().replace("_", " "), text))


def heading(text: str) -> str:
    """A title as by `words`, with its unit as printed: gap [µm] for ``gap [um]``, share for ``share [1]``."""
    match = _WITH_UNIT.fullmatch(text)
    if match is None:
        return words(text)
    title, unit, remark = match.groups(default="")
    sign = symbol(unit)
    return words(title) + (f" [{sign}]" if sign else "") + words(remark)


def begun(text: str) -> str:
    """A sentence with a capital letter, unless it begins with a name such as ``hl32-textbook``."""
    first = text.split(maxsplit=1)[0] if text.strip() else ""
    return text[0].upper() + text[1:] if first.strip(",:;'").isalpha() else text


def _scientific(mantissa: str, exponent: str) -> str:
    power = f"10{str(int(exponent)).translate(_SUPERSCRIPT)}"
    return power if mantissa == "1" else f"{mantissa}·{power}"


def number(value: float | None, digits: int = 4) -> str:
    """A value to `digits` significant digits; a dash when it is missing."""
    if value is None or not math.isfinite(value):
        return MISSING
    text = significant(value, digits)
    if "e" in text:
        mantissa, exponent = text.split("e")
        text = f"{mantissa}·10{str(int(exponent)).translate(_SUPERSCRIPT)}"
    return text.replace("-", "−", 1) if text.startswith("-") else text


def setting(value: float) -> str:
    """A value that was set, or else the middle of the readings: to four digits, or whole."""
    return number(value, 4 if abs(value) < 1e3 else 7)


def amount(value: float | None, unit: str, digits: int = 4) -> str:
    """A value with its unit, given in the form used in files: ``amount(40, "degC")`` is ``40 °C``."""
    return with_unit(number(value, digits), unit)


def with_unit(text: str, unit: str) -> str:
    """Append the printed unit to a number that is already text, with a space that does not break."""
    sign = symbol(unit)
    return f"{text}\N{NO-BREAK SPACE}{sign}" if sign and text != MISSING else text


def decimals(values: Iterable[float], digits: int = 4) -> int:
    """The number of decimals that gives the largest of the values `digits` significant digits."""
    # One number of decimals for a column, by its largest value: the points then stand above one another.
    largest = max((abs(value) for value in values if math.isfinite(value)), default=0.0)
    if largest == 0.0:
        return 0
    return min(max(digits - 1 - math.floor(math.log10(largest)), 0), 9)


def fixed(value: float | None, digits: int, *, sign: bool = False) -> str:
    """A value with a fixed number of decimals, so that a column lines up."""
    if value is None or not math.isfinite(value):
        return MISSING
    text = f"{value:+.{digits}f}" if sign else f"{value:.{digits}f}"
    if not float(text):
        text = text.lstrip("+-")
    return text.replace("-", "−", 1)


def resolved(value: float, scale: float) -> float:
    """A value to a hundredth of `scale`: anything smaller in a mean error is rounding, and so is its sign."""
    step = 0.01 * scale
    return round(value / step) * step + 0.0 if step > 0.0 else value


def duration(seconds: float | None) -> str:
    """A duration in its two largest units, e.g. ``3 h 12 min``."""
    if seconds is None or not math.isfinite(seconds):
        return MISSING
    space = "\N{NO-BREAK SPACE}"
    if abs(seconds) < 60.0:
        return f"{number(seconds, 3)}{space}s"
    rounded = round(seconds)
    if rounded < 3600:
        return f"{rounded // 60}{space}min {rounded % 60:02d}{space}s"
    minutes = round(seconds / 60.0)
    return f"{minutes // 60}{space}h {minutes % 60:02d}{space}min"


def moment(text: str | None) -> str:
    """An instant from its ISO form, to the second, with its zone; unreadable text is unchanged."""
    if not text:
        return MISSING
    try:
        when = datetime.fromisoformat(text)
    except ValueError:
        return text
    return when.strftime("%Y-%m-%d %H:%M:%S ") + (when.tzname() or "") if when.tzinfo else when.isoformat(" ")


def probability(value: float) -> str:
    """A probability in per cent, rounded to whole numbers, but never to 0 or 100."""
    if value > 0.99:
        return "over 99 %"
    return f"{100.0 * value:.0f} %" if value >= 0.01 else "under 1 %"


def plural(count: int, one: str, several: str | None = None) -> str:
    """``1 record``, ``28 records``."""
    return f"{whole(count)} {noun(count, one, several)}"


def whole(count: int) -> str:
    """A count with separated thousands: ``65 100``."""
    return f"{count:,}".replace(",", "\N{NARROW NO-BREAK SPACE}")
