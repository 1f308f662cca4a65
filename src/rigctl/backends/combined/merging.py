"""Samples of the whole bench out of the readings of its devices."""

from __future__ import annotations

import math
from bisect import insort
from collections.abc import Sequence
from operator import itemgetter

from rigctl.backends.protocol import CommandReceipt, Reading, Sample
from rigctl.rig import Rig

#: before the bench is sampled at a known rate
_ANY_AGE: tuple[float, Sequence[tuple[int, float]]] = (math.inf, ())

#: changes of each command that are remembered, for readings that arrive after them
_REMEMBERED = 1000


class Merging:
    """The newest value of every channel, and the commands in force at the time of each reading."""

    def __init__(self, rig: Rig) -> None:
        self._rig = rig
        layout = rig.layout
        self._channels = {
            name: tuple(layout.channels.index(channel) for channel in part.layout.channels)
            for name, part in rig.parts.items()
        }
        self._commands = {
            name: tuple(layout.commands.index(command) for command in part.layout.commands)
            for name, part in rig.parts.items()
        }
        self._nothing = [math.nan] * len(layout.channels)
        self._newest = self._nothing.copy()
        self._commanded = [float(rig.safe_state.get(name, 0.0)) for name in layout.commands]  # once open
        #: of each command since when (s) it has had which value
        self._changes = [[(-math.inf, value)] for value in self._commanded]
        self.read_at: dict[str, float] = {}  #: time of each device's newest reading, s
        #: by device: the age at which the first of its channels has no value any more, s, and that of each
        self._limits: dict[str, tuple[float, Sequence[tuple[int, float]]]] = {}
        self._changed = self._time = -math.inf

    def start(self, rate: float) -> None:
        """Take note of the rate at which the bench is sampled, Hz."""
        for name, part in self._rig.parts.items():
            limits = [self._rig.stale_limit(channel, rate) for channel in part.layout.channels]
            each = tuple(zip(self._channels[name], limits, strict=True))
            self._limits[name] = min(limits, default=math.inf), each

    def switched(self, receipt: CommandReceipt) -> None:
        """Take note of a command that has been carried out, before its device is read again."""
        self._note(receipt.time, self._rig.layout.commands.index(receipt.actuator), receipt.value)

    def sample(self, device: str, sample: Sample) -> Sample:
        """Return the sample of the whole bench for a device's own one."""
        own, newest = self._nothing.copy(), self._newest
        for column, value in zip(self._channels[device], sample.values, strict=True):
            own[column] = newest[column] = value
        for column, value in zip(self._commands[device], sample.commands, strict=True):
            self._note(sample.time, column, value)
        self.read_at[device] = sample.time
        self._time = max(self._time, sample.time)  # one that was long under way does not set the time back
        return Sample(
            self._time,
            self._values(device),
            tuple(self._commanded),
            Reading(device, sample.time, tuple(own), self._commands_at(sample.time)),
        )

    def _values(self, read: str) -> tuple[float, ...]:
        """Return the newest values that are not too old; one that was just read is not, however late.

        Their age is that at the newest reading: what is fetched late, after a stall, is not old.
        """
        values = self._newest
        for name, time in self.read_at.items():
            first, limits = self._limits.get(name, _ANY_AGE)
            age = self._time - time
            if age <= first or name == read:
                continue
            if values is self._newest:
                values = values.copy()
            for column, limit in limits:
                if age > limit:
                    values[column] = math.nan
        return tuple(values)

    def _note(self, time: float, column: int, value: float) -> None:
        """Take note that a command had a value at a time; receipts and readings come in any order."""
        # A history and not the newest value alone: the reading of a slow device arrives after commands that
        # were given since, and must state those that were in force when it was taken.
        changes = self._changes[column]
        newest = changes[-1]
        if (newest[1] if newest[0] <= time else _at(changes, time)) == value:
            return
        insort(changes, (time, value), key=itemgetter(0))
        del changes[:-_REMEMBERED]
        self._changed = max(self._changed, time)
        self._commanded[column] = changes[-1][1]

    def _commands_at(self, time: float) -> tuple[float, ...]:
        """Return the commands of all devices at a time, which later ones have replaced since."""
        if self._changed <= time:
            return tuple(self._commanded)
        return tuple(_at(changes, time) for changes in self._changes)


def _at(changes: list[tuple[float, float]], time: float) -> float:
    """Return the value at a time; the oldest that is known for an earlier one."""
    return next((value for since, value in reversed(changes) if since <= time), changes[0][1])
