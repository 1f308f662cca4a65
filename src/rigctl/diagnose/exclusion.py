"""An effect that a table excludes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Exclusion:
    """An effect that cannot be what is missing, alone.

    Attributes
    ----------
    reached: the share of the missing change that it makes at its best: 0 for none, below 0 for the wrong way;
        `at_most` the largest at any size that was looked at, up to the largest that is usual.
    only: the conditions at which it makes at least half of it; empty where at none or at all.
    worse: by so many standard deviations it fits less well than the best does.
    """

    effect: str
    reached: float
    only: tuple[str, ...]
    worse: float
    at_most: float

    def document(self) -> dict[str, Any]:
        """Its machine-readable form."""
        return {
            "effect": self.effect,
            "reached": self.reached,
            "at_most": self.at_most,
            "only": list(self.only),
            "worse": self.worse,
        }
