"""The statistics of recorded samples that a measure may use, and how they are written.

A measure is an expression over statistics: ``max(position) - min(position)``, ``mean(supply_pressure)``, or
``(last(position) - first(position)) / duration``. A statistic is one of the names below, called on one
channel or command; ``duration`` alone is the length of the stretch in seconds. The rest follows the
restricted grammar of all expressions.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from types import MappingProxyType
from typing import Final

#: the name of the length of the stretch, in seconds
DURATION: Final = "duration"


def _mean(values: Sequence[float]) -> float:
    return math.fsum(values) / len(values)


def _std(values: Sequence[float]) -> float:
    """Return the sample standard deviation, with n − 1 degrees of freedom; NaN for a single sample."""
    if len(values) < 2:
        return math.nan
    mean = _mean(values)
    return math.sqrt(math.fsum((value - mean) ** 2 for value in values) / (len(values) - 1))


#: all statistics by name; they are computed after missing samples (NaN) have been removed
STATISTICS: Final[Mapping[str, Callable[[Sequence[float]], float]]] = MappingProxyType(
    {
        "first": lambda values: values[0],
        "last": lambda values: values[-1],
        "min": min,
        "max": max,
        "mean": _mean,
        "std": _std,
    }
)


class Stretch(Enum):
    """The samples over which the statistics of a measure are taken."""

    RECORD = "record"  #: the open record, from its first sample to now
    PHASE = "phase"  #: since the last change of a command
    WINDOW = "window"  #: the last `window` seconds, inside a record or outside


_CALL = re.compile(r"\b(" + "|".join(STATISTICS) + r")\s*\(\s*([A-Za-z_]\w*)\s*\)")


@dataclass(frozen=True, slots=True)
class Statistic:
    """One statistic of one channel or command over a stretch of samples."""

    kind: str
    channel: str

    @property
    def key(self) -> str:
        """The name of this statistic in the expression, e.g. ``max_of_position``."""
        return f"{self.kind}_of_{self.channel}"

    @property
    def difference(self) -> bool:
        """True if the result is an interval, such as a standard deviation of temperatures."""
        return self.kind == "std"

    def compute(self, values: Sequence[float]) -> float:
        """Return the statistic of these samples, SI; NaN if all are missing."""
        present = [value for value in values if not math.isnan(value)]
        return STATISTICS[self.kind](present) if present else math.nan


def find_statistics(text: str) -> tuple[str, tuple[Statistic, ...]]:
    """Extract the statistics from a measure's text.

    Returns
    -------
    The text with ``max(position)`` written as the name ``max_of_position``, and its statistics, each once.
    ``max(a, b)`` with two arguments remains an ordinary function.
    """
    found: dict[str, Statistic] = {}

    def name_it(match: re.Match[str]) -> str:
        statistic = Statistic(match.group(1), match.group(2))
        found[statistic.key] = statistic
        return statistic.key

    return _CALL.sub(name_it, text), tuple(found.values())
