"""Quantities as they are written into a file."""

from __future__ import annotations

import math

from rigctl.errors import RigctlError
from rigctl.units import Unit, interval_unit, onto_bound, parse_unit

#: least number of digits, because correlated parameters are sensitive to each other's rounding
_DIGITS = 6
#: for a value without a known uncertainty
_DIGITS_OF_EXACT = 10
_MOST = 17


def value_text(
    si: float,
    unit: str,
    *,
    std: float | None = None,
    difference: bool = False,
    low: float = -math.inf,
    high: float = math.inf,
) -> str:
    """An SI value as written in a file: with its digits down to a hundredth of `std`, at least six.

    A value within `low` and `high` is still within them after it is read again.

    Raises
    ------
    RigctlError
        the value is not finite.
    """
    if not math.isfinite(si):
        raise RigctlError("a value of the model is not a finite number", value=str(si))
    parsed = parse_unit(unit)
    value = parsed.from_si(si, difference=difference)
    digits = _digits(value, None if std is None else std / parsed.factor)
    while digits < _MOST:
        again = onto_bound(parsed.to_si(float(f"{value:.{digits}g}"), difference=difference), low, high)
        if low <= again <= high:
            break
        digits += 1
    return _with_unit(f"{value:.{digits}g}", parsed)


def std_text(std: float, unit: str) -> str:
    """A standard deviation (SI) to two digits; of a temperature scale in kelvin."""
    parsed = parse_unit(interval_unit(unit))
    return _with_unit(f"{std / parsed.factor:.2g}", parsed)


def _digits(value: float, std: float | None) -> int:
    if std is None or not math.isfinite(std) or std <= 0.0 or value == 0.0:
        return _DIGITS_OF_EXACT
    digits = math.floor(math.log10(abs(value))) - math.floor(math.log10(std)) + 3
    return min(max(digits, _DIGITS), _MOST)


def _with_unit(number: str, unit: Unit) -> str:
    return number if unit.text in ("", "1") else f"{number} {unit.text}"
