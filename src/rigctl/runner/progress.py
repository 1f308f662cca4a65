"""How far a run is, by what its steps are expected to take."""

from __future__ import annotations

from collections.abc import Mapping


class Progress:
    """Share of the expected duration that is done.

    Parameters
    ----------
    expected: s that each step of the plan is expected to take, by path; loops counted once.
    records_total: how many records the plan has.
    """

    def __init__(self, expected: Mapping[str, float], records_total: int) -> None:
        self._expected = expected
        self._total = sum(expected.values())
        self._done = 0.0
        self._seen: set[str] = set()
        self._current = ""
        self._since = 0.0
        self.path = ""
        self.label = ""
        self.records_done = 0
        self.records_total = records_total

    def begin(self, planned: str, path: str, label: str, time: float) -> None:
        """A step begins; `planned` is its path in the plan, `path` the one with the rounds of its loops."""
        self._current, self.path, self.label, self._since = planned, path, label, time

    def end(self, planned: str, time: float) -> None:
        """A step is over."""
        if planned not in self._seen:
            self._seen.add(planned)
            self._done += self._expected.get(planned, 0.0)
        self._current, self._since = "", time

    def left(self, time: float) -> float | None:
        """Expected s until the end; None when nothing is known."""
        if self._total <= 0.0:
            return None
        return max(self._total - self._done - self._of_current(time), 0.0)

    def share(self, time: float) -> float:
        """0 to 1."""
        if self._total <= 0.0:
            return 0.0
        return min((self._done + self._of_current(time)) / self._total, 1.0)

    def _of_current(self, time: float) -> float:
        if not self._current or self._current in self._seen:
            return 0.0
        return min(time - self._since, self._expected.get(self._current, 0.0))
