"""The line between host and simulated bench: when it is dead, and when only the samples are missing."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from rigctl.backends.simulated.faults import Fault


class Link:
    """Times without samples and without any contact, from the faults; s since opening."""

    def __init__(self, faults: Iterable[Fault]) -> None:
        faults = tuple(faults)
        self.losses = _intervals(faults, "backend_lost")
        self._silences = (*self.losses, *_intervals(faults, "samples_stop"))

    @property
    def perfect(self) -> bool:
        """Whether nothing is ever lost."""
        return not self._silences

    def silent(self, time: float) -> bool:
        """Return whether a sample taken at `time` is lost."""
        return any(begin <= time < end for begin, end in self._silences)

    def back_at(self, time: float) -> float:
        """Return when the bench can next be reached, s: `time` itself, the end of the loss, or infinity."""
        return max((end for begin, end in self.losses if begin <= time < end), default=time)


def _intervals(faults: Sequence[Fault], kind: str) -> tuple[tuple[float, float], ...]:
    return tuple((fault.begin, fault.end) for fault in faults if fault.kind == kind)
