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
from rigctl.rig import Rig
from rigctl.steps.measure import Measure

#: old samples are dropped when this many more than needed have accumulated
_SPARE = 20_000
_SLACK = 1e-9  # s; times on a sampling grid are sums of rounded numbers


class _Stretches:
    """Recent samples of the signals of one device.

    Parameters
    ----------
    signals: index of the column of each signal that a measure names.
    """

    def __init__(self, signals: Mapping[str, int]) -> None:
        self._columns = tuple(signals.values())
        self._times = array("d")
        self.values = {name: array("d") for name in signals}
        self._stores = tuple(self.values.values())

    def add(self, row: Row) -> None:
        self._times.append(row[0])
        for store, column in zip(self._stores, self._columns, strict=True):
            store.append(row[column])

    def __len__(self) -> int:
        return len(self._times)

    def first_at(self, time: float) -> int:
        """The index of the first sample at a time or later."""
        return bisect_left(self._times, time)

    def forget(self, before: float) -> None:
        count = self.first_at(before)
        del self._times[:count]
        for store in self._stores:
            del store[:count]


class History:
    """Recent samples of some signals.

    Inside a record all of its samples are kept, between records those of the longest `window`.

    Parameters
    ----------
    signals: index of the column of each signal that a measure names, by the device that reads it.
    window: s, the longest window of any measure.
    """

    def __init__(self, signals: Mapping[str, Mapping[str, int]], window: float) -> None:
        self._window = window
        self._devices = {device: _Stretches(own) for device, own in signals.items()}
        self._device_of = {name: device for device, own in signals.items() for name in own}
        self._record_start: float | None = None
        self._phase_start = -math.inf
        self.wanted = any(signals.values()) or window > 0.0

    def add(self, row: Row, device: str) -> None:
        """Keep one sample of a device."""
        kept = self._devices[device]
        kept.add(row)
        # Not at each sample: removing from the front of an array moves all that follows.
        if self._record_start is None and len(kept) > _SPARE:
            kept.forget(row[0] - self._window)

    def begin_record(self, time: float) -> None:
        """A record begins: earlier samples are no longer needed, except for windows that reach back."""
        for kept in self._devices.values():
            kept.forget(time - self._window)
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
        values = {
            statistic.key: statistic.compute(self._stretch(statistic.channel, start)) for statistic in wanted
        }
        return {**values, DURATION: now - (start if math.isfinite(start) else now)}

    def lack(self, wanted: Sequence[Statistic], stretch: Stretch, window: float | None, now: float) -> Lack:
        """How many readings of the stretch the statistics leave out, of the worst channel."""
        start = self._start_of(stretch, window, now)
        # Where nothing is missing, the device with most readings in the stretch tells how many there were.
        counts = [len(kept) - kept.first_at(start - _SLACK) for kept in self._devices.values()]
        found = Lack("readings", 0, max(counts))
        for name in {statistic.channel for statistic in wanted}:
            readings = self._stretch(name, start)
            missing = sum(map(math.isnan, readings))
            if missing > found.missing:
                found = Lack(f"readings of {name}", missing, len(readings))
        return found

    def _stretch(self, name: str, start: float) -> array[float]:
        kept = self._devices[self._device_of[name]]
        return kept.values[name][kept.first_at(start - _SLACK) :]

    def _start_of(self, stretch: Stretch, window: float | None, now: float) -> float:
        if stretch is Stretch.WINDOW:
            return now - (window or 0.0)
        if stretch is Stretch.PHASE:
            return self._phase_start
        return self._record_start if self._record_start is not None else self._phase_start


def history_for(plan: Plan, rig: Rig) -> History:
    """A history that keeps only what the plan's measures name."""
    columns = {name: index for index, name in enumerate(rig.layout.columns)}
    signals: dict[str, dict[str, int]] = {device: {} for device in rig.parts}
    any_device, *_ = signals  # commands that the operator carries out belong to none
    window = 0.0
    for measure in _measures(plan):
        for statistic in measure.statistics:
            device = rig.device_of(statistic.channel) or any_device
            signals[device][statistic.channel] = columns[statistic.channel]
        window = max(window, measure.window or 0.0)
    return History(signals, window)


def _measures(plan: Plan) -> Iterable[Measure]:
    for node in all_nodes(plan):
        if isinstance(node, Leaf) and isinstance(node.action, Measure):
            yield node.action
