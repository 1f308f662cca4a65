"""One trial on a real log: which log, and how much of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from rigctl_validation.real.logs import LOGS

#: rows to which the logs are cut; 0 for the whole log
LENGTHS = (0, 100, 300, 360, 1000)
#: logs that are shorter than the longest cut
_ROWS = {"dryer": 500}


@dataclass(frozen=True)
class RealTrial:
    """A real log, cut to its first rows; 0 for the whole log."""

    log: str
    rows: int = 0

    @property
    def name(self) -> str:
        """``hoop, 300 rows``, or ``hoop, whole``."""
        return f"{self.log}, {self.extent}"

    @property
    def extent(self) -> str:
        """How much of the log, in words."""
        return f"{self.rows} rows" if self.rows else "whole"

    @property
    def truth(self) -> tuple[str, ...]:
        """Patterns of names of effects that are a right answer."""
        return LOGS[self.log].right

    def document(self) -> dict[str, Any]:
        """The trial as plain data."""
        return asdict(self)

    @classmethod
    def read(cls, document: Mapping[str, Any]) -> RealTrial:
        """The trial that `document` describes."""
        return cls(**document)


def real_trials() -> tuple[RealTrial, ...]:
    """Every log whole, then every log cut: the first trials are a sample of all logs."""
    return tuple(
        RealTrial(name, rows) for rows in LENGTHS for name in LOGS if rows < _ROWS.get(name, rows + 1)
    )
