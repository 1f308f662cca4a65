"""Values as JSON has them."""

from __future__ import annotations

import math


def finite_or_none(value: float) -> float | None:
    """The value, or None for NaN and infinities, which JSON does not have."""
    return value if math.isfinite(value) else None
