"""Counted nouns and lists of names, as a sentence has them."""

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
