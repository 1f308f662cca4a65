"""A remark on measurements, with the kind that decides where it is shown."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Note:
    """A remark on measurements.

    Attributes
    ----------
    kind: ``taken`` if it describes how the data were taken, as every comparison has it; ``spikes`` if it
        counts those of one channel; else it has to be known before a verdict is trusted.
    """

    text: str
    kind: Literal["taken", "spikes", "unusual"] = "unusual"

    def __str__(self) -> str:
        """The remark."""
        return self.text


def as_notes(texts: Iterable[str | Note]) -> tuple[Note, ...]:
    """Notes, and texts that have to be known."""
    return tuple(one if isinstance(one, Note) else Note(one) for one in texts)
