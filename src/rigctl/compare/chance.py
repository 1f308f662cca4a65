"""A p-value as it is read."""

from __future__ import annotations

_LEAST = 1e-6


def chance(p_value: float) -> str:
    """``0.03``, or ``< 1e-6``."""
    return "< 1e-6" if p_value < _LEAST else f"{p_value:.2g}"


def chance_text(p_value: float) -> str:
    """``p = 0.03``, or ``p < 1e-6``."""
    return f"p {chance(p_value)}" if p_value < _LEAST else f"p = {chance(p_value)}"
