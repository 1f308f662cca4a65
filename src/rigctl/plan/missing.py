"""How much of a record, or of what a measure is taken over, may be missing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

#: share of samples, or of the readings of a channel, that may be missing unless a procedure says otherwise
MOST_MISSING: Final = 0.05


@dataclass(frozen=True, slots=True)
class Lack:
    """What is missing: `missing` of `total` samples, or of the readings of a channel, called `what`."""

    what: str
    missing: int
    total: int

    @property
    def share(self) -> float:
        """The missing share, 0 to 1."""
        return self.missing / self.total if self.total else 0.0

    def exceeds(self, most: float) -> bool:
        """Return whether more is missing than the share `most`; a single one never is too much."""
        return self.missing > 1 and self.share > most

    def __str__(self) -> str:
        """The numbers and the share: ``3 of 60 readings of position (5 %)``."""
        digits = 2 if self.share < 0.995 else 3  # 100 has three
        return f"{self.missing} of {self.total} {self.what} ({100.0 * self.share:.{digits}g} %)"
