"""Counted nouns, lists of names, p-values and shares, as a sentence has them."""

from __future__ import annotations

from collections.abc import Sequence


def noun(count: int, one: str, several: str | None = None) -> str:
    """``record`` for 1, ``records`` otherwise."""
    return one if count == 1 else several or f"{one}s"


def number_of(count: int, one: str, several: str | None = None) -> str:
    """``1 record``, ``28 records``."""
    return f"{count} {noun(count, one, several)}"


def listed(names: Sequence[str], last: str = "and") -> str:
    """``a``, ``a and b``, ``a, b and c``."""
    return f"{', '.join(names[:-1])} {last} {names[-1]}" if len(names) > 1 else "".join(names)


#: p-values below this are only bounded
_LEAST = 1e-6


def chance(p_value: float) -> str:
    """``0.03``, or ``< 1e-6``."""
    return "< 1e-6" if p_value < _LEAST else f"{p_value:.2g}"


def chance_text(p_value: float) -> str:
    """``p = 0.03``, or ``p < 1e-6``."""
    return f"p {chance(p_value)}" if p_value < _LEAST else f"p = {chance(p_value)}"


def share_text(share: float) -> str:
    """A share of a misfit: ``2 %``, ``0.03 %``."""
    per_cent = 100.0 * share
    return f"{per_cent:.0f} %" if per_cent >= 1.0 else f"{per_cent:.1g} %"


def strength(size: float) -> str:
    """The size of one effect in standard deviations of what noise alone makes of it.

    It is none of a remainder: the √χ² that noise alone leaves grows with the number of readings.
    """
    number = f"{size:.0f}" if size >= 10.0 else f"{size:.1f}"
    return f"{number} times as strong as chance"
