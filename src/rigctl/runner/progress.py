"""The progress of a run, from the expected durations of its steps."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping

from rigctl.plan import Leaf, Loop, Node, Plan, children, walk
from rigctl.runner.remaining_plan import record_paths


class Progress:
    """Completed share of the expected duration.

    Parameters
    ----------
    expected: s that each step of the plan is expected to take each time, by path.
    times: how often each step is expected to be carried out, by path.
    records_total: how many records the plan has.
    """

    def __init__(self, expected: Mapping[str, float], times: Mapping[str, int], records_total: int) -> None:
        self._expected = expected
        self._remaining = dict(times)
        self._total = sum(seconds * times.get(path, 1) for path, seconds in expected.items())
        self._done = 0.0
        self._current = ""
        self._since = 0.0
        self.label = ""
        self.records_done = 0
        self.records_total = records_total

    def begin(self, planned: str, label: str, time: float) -> None:
        """Note the start of a step; `planned` is its path in the plan, without the rounds of its loops."""
        self._current, self.label, self._since = planned, label, time

    def end(self, time: float) -> None:
        """Note the end of the step."""
        remaining = self._remaining.get(self._current, 0)
        if remaining > 0:
            self._remaining[self._current] = remaining - 1
            self._done += self._expected.get(self._current, 0.0)
        self._current, self._since = "", time

    def skip(self, node: Node) -> None:
        """Note that the steps below a node were done in an earlier session."""
        for below in walk(node):
            if isinstance(below, Leaf) and self._remaining.get(below.path, 0) > 0:
                self._remaining[below.path] -= 1
                self._total -= self._expected.get(below.path, 0.0)

    def remaining(self, time: float) -> float | None:
        """Expected time until the end, s; None if unknown."""
        if self._total <= 0.0:
            return None
        return max(self._total - self._done - self._of_current(time), 0.0)

    def share(self, time: float) -> float:
        """0 to 1."""
        if self._total <= 0.0:
            return 0.0
        return min((self._done + self._of_current(time)) / self._total, 1.0)

    def _of_current(self, time: float) -> float:
        if self._remaining.get(self._current, 0) <= 0:
            return 0.0
        return min(time - self._since, self._expected.get(self._current, 0.0))


def progress_of(plan: Plan) -> Progress:
    """Progress by the forecast of the plan."""
    from rigctl.planning import preview

    times: Counter[str] = Counter()
    for root in (plan.root, plan.finally_):
        if root is not None:
            _count(root, 1, times)
    return Progress(preview(plan).durations(), times, len(record_paths(plan.root)))


def _count(node: Node, rounds: int, times: Counter[str]) -> None:
    if isinstance(node, Leaf):
        times[node.path] += rounds
    inner = rounds * (node.count if isinstance(node, Loop) and node.count is not None else 1)
    for child in children(node):
        _count(child, inner, times)
