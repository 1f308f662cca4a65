"""The samples that the measures of a plan need, kept in memory; only of the channels that they name."""

from __future__ import annotations

import math
from array import array
from bisect import bisect_left
from collections.abc import Iterable, Mapping, Sequence

from rigctl.plan import Leaf, Plan, all_nodes
from rigctl.plan.behaviour import Row
from rigctl.plan.missing import Lack
from rigctl.plan.statistics import DURATION, Statistic, Stretch
from rigctl.steps.measure import Measure

#: old samples are dropped when this many more than needed have accumulated
_SPARE = 20_000


class History:
    """Recent samples of some signals.

    Inside a record all of its samples are kept, between records those of the longest `window`.

    Parameters
    ----------
    signals: index of the column of each signal that a measure names.
    window: s, the longest window of any measure.
    """

    def __init__(self, signals: Mapping[str, int], window: float) -> None:
        self._columns = tuple(signals.values())
        self._window = window
        self._times = array("d")
        self._values = {name: array("d") for name in signals}
        self._stores = tuple(self._values.values())
        self._record_start: float | None = None
        self._phase_start = -math.inf
        self.wanted = bool(signals) or window > 0.0

    def add(self, row: Row) -> None:
        """Keep one sample."""
        self._times.append(row[0])
        for store, column in zip(self._stores, self._columns, strict=True):
            store.append(row[column])
        if self._record_start is None and len(self._times) > _SPARE:
            self._forget(row[0] - self._window)

    def begin_record(self, time: float) -> None:
        """A record begins: earlier samples are no longer needed, except for windows that reach back."""
        self._forget(time - self._window)
        self._record_start = self._phase_start = time

    def end_record(self) -> None:
        """The record is over; its measures have been taken."""
        self._record_start = None

    def begin_phase(self, time: float) -> None:
        """Note that a command has changed."""
        self._phase_start = time

    def statistics(
        self, wanted: Sequence[Statistic], stretch: Stretch, window: float | None, now: float
    ) -> dict[str, float]:
        """The statistics by key, and the stretch's ``duration`` in s; `window` (s) goes with WINDOW."""
        start = self._start_of(stretch, window, now)
        first = bisect_left(self._times, start - 1e-9)
        values = {
            statistic.key: statistic.compute(self._values[statistic.channel][first:]) for statistic in wanted
        }
        return {**values, DURATION: now - (start if math.isfinite(start) else now)}

    def lack(self, wanted: Sequence[Statistic], stretch: Stretch, window: float | None, now: float) -> Lack:
        """How many readings of the stretch the statistics leave out, of the worst channel."""
        first = bisect_left(self._times, self._start_of(stretch, window, now) - 1e-9)
        found = Lack("readings", 0, len(self._times) - first)
        for name in {statistic.channel for statistic in wanted}:
            missing = sum(map(math.isnan, self._values[name][first:]))
            if missing > found.missing:
                found = Lack(f"readings of {name}", missing, found.total)
        return found

    def _start_of(self, stretch: Stretch, window: float | None, now: float) -> float:
        if stretch is Stretch.WINDOW:
            return now - (window or 0.0)
        if stretch is Stretch.PHASE:
            return self._phase_start
        return self._record_start if self._record_start is not None else self._phase_start

    def _forget(self, before: float) -> None:
        count = bisect_left(self._times, before)
        del self._times[:count]
        for store in self._stores:
            del store[:count]


def history_for(plan: Plan, columns: Mapping[str, int]) -> History:
    """A history that keeps only what the plan's measures name."""
    signals: dict[str, int] = {}
    window = 0.0
    for measure in _measures(plan):
        signals.update({statistic.channel: columns[statistic.channel] for statistic in measure.statistics})
        window = max(window, measure.window or 0.0)
    return History(signals, window)


def _measures(plan: Plan) -> Iterable[Measure]:
    for node in all_nodes(plan):
        if isinstance(node, Leaf) and isinstance(node.action, Measure):
            yield node.action
