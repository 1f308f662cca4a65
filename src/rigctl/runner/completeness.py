"""Counts what a record lacks: samples that did not come, and readings without a value."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from typing import Final

from rigctl.plan.behaviour import Row
from rigctl.plan.missing import Lack
from rigctl.rig import Rig

#: s, and sampling periods, by which the newest sample of a record that ends may be late
_LATE: Final = 0.5
_LATE_PERIODS: Final = 2.0


class _OfDevice:
    """The readings of one device in the open record.

    A device that is asked for ``r`` samples a second owes ``r (t − t₀) + 1`` from its first sample at t₀ to
    its newest at t, and those between that and the end of the record, unless they may still be on their way.
    Their times may jitter: only their number counts. One without any sample owes those since the record
    `began`.
    """

    def __init__(self, channels: Mapping[str, int], rate: float, named: str, began: float) -> None:
        self._columns = channels
        self._rate = rate
        self._named = named
        self._first = self._newest = began
        self._rows = 0
        self._without = dict.fromkeys(channels, 0)

    def add(self, row: Row, *, possible: bool) -> None:
        """Count a sample; `possible`: every channel has a value."""
        if not self._rows:
            self._first = row[0]
        self._newest = row[0]
        self._rows += 1
        if not possible:
            for name, column in self._columns.items():
                value = row[column]
                self._without[name] += value != value  # noqa: PLR0124 - only NaN differs from itself

    def lacks(self, now: float) -> list[Lack]:
        """Return what is missing at `now`, s: samples, then the readings of each channel."""
        found = []
        # Samples of the last moments may be on their way. Later ones than the newest are owed only if they
        # are overdue.
        seen_until = max(self._newest, now - _LATE - _LATE_PERIODS / self._rate)
        # Rounded: the grid of the device jitters, and its clock is not exactly ours.
        due = int((seen_until - self._first) * self._rate + 0.5) + bool(self._rows)
        if due > self._rows:
            found.append(Lack(self._named, due - self._rows, due))
        found += [
            Lack(f"readings of {name}", count, self._rows) for name, count in self._without.items() if count
        ]
        return found


class Completeness:
    """The samples of one record so far, of each device of the bench by itself.

    Parameters
    ----------
    rig: the bench.
    channels: names of the channels of the record.
    rate: Hz, of the record; a slow device owes fewer samples.
    began: when it was opened, s.
    """

    def __init__(self, rig: Rig, channels: Iterable[str], rate: float, began: float) -> None:
        columns: dict[str, dict[str, int]] = {device: {} for device in rig.parts}
        for name in channels:
            columns[rig.device_of(name)][name] = rig.layout.columns.index(name)
        self._devices = {
            device: _OfDevice(
                own, rig.rate_of(device, rate), f"samples of {device}" if device else "samples", began
            )
            for device, own in columns.items()
        }

    def add(self, row: Row, device: str, *, possible: bool) -> None:
        """Count a sample of a device; `possible`: every channel has a value."""
        self._devices[device].add(row, possible=possible)

    def lacks(self, now: float, without: Collection[str] = ()) -> list[Lack]:
        """Return what is missing at `now`, s: samples of each device, then the readings of each channel.

        Devices in `without` are left out.
        """
        counted = (device for name, device in self._devices.items() if name not in without)
        return [lack for device in counted for lack in device.lacks(now)]


def worst(lacks: Collection[Lack]) -> float:
    """Return the largest missing share; 0 if nothing is missing."""
    return max((lack.share for lack in lacks), default=0.0)
