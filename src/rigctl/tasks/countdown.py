"""How far a long loop is, and how long it will still take: ``Refitting: 3 of 7, about 40 s left``."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from time import monotonic
from typing import TypeVar

T = TypeVar("T")

#: time that is not worth announcing, s
_SOON = 1.0


class Countdown:
    """Reports the progress of a loop; the time left is estimated from the pieces done so far.

    Parameters
    ----------
    what: the description of the loop.
    report: called with the complete text.
    now: the time, s.
    """

    def __init__(
        self, what: str, report: Callable[[str], None], *, now: Callable[[], float] = monotonic
    ) -> None:
        self._what, self._report, self._now = what, report, now
        self._began = now()

    def __call__(self, done: int, total: int) -> None:
        """Report that `done` of `total` pieces are done."""
        self._report(f"{self._what}: {done} of {total}{self._left(done, total)}")

    def begin(self, number: int, total: int) -> None:
        """Report that piece `number`, counted from 1, has begun; a single piece is not counted."""
        count = f": {number} of {total}{self._left(number - 1, total)}" if total > 1 else ""
        self._report(f"{self._what}{count}")

    def _left(self, done: int, total: int) -> str:
        left = (self._now() - self._began) / done * (total - done) if done else 0.0
        return f", about {duration_text(left)} left" if left >= _SOON else ""


def counted(pieces: Sequence[T], what: str, report: Callable[[str], None]) -> Iterator[T]:
    """Yield the pieces, and report each before it: ``what: 3 of 7, about 40 s left``."""
    countdown = Countdown(what, report)
    for number, piece in enumerate(pieces, start=1):
        countdown.begin(number, len(pieces))
        yield piece


def duration_text(seconds: float) -> str:
    """A duration in its two largest units: ``40 s``, ``2 min 05 s``, ``1 h 10 min``."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return (
        f"{hours} h {minutes:02d} min" if hours else f"{minutes} min {rest:02d} s" if minutes else f"{rest} s"
    )
