"""The bounds of a parameter, and the error for a value beyond them."""

from __future__ import annotations

import math

from rigctl.errors import RigctlError
from rigctl.units import onto_bound, show


def within(
    name: str, si: float, low: float, high: float, unit: str, written: str = "", *, difference: bool = False
) -> float:
    """An SI value, moved to a bound that it exceeds only by rounding.

    Parameters
    ----------
    name: as the user knows the parameter; `written` is the value in the file, by default `si` in `unit`.

    Raises
    ------
    RigctlError
        it is beyond `low` or `high`.
    """
    value = onto_bound(si, low, high)
    if low <= value <= high:
        return value
    ends = [show(end, unit, difference=difference) for end in (low, high) if math.isfinite(end)]
    shown = written or show(si, unit, difference=difference)
    expected = (
        " to ".join(ends) if len(ends) > 1 else f"{'at least' if low > -math.inf else 'at most'} {ends[0]}"
    )
    raise RigctlError(f"{name} is out of bounds", value=shown, expected=expected)
