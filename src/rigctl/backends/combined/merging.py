"""Samples of the whole bench out of the readings of its devices."""

from __future__ import annotations

import math
from collections import deque

from rigctl.backends.protocol import Reading, Sample
from rigctl.rig import Rig

#: changes of commands that are remembered, for readings that arrive after them
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
        self._nothing = (math.nan,) * len(layout.channels)
        self._newest = list(self._nothing)
        self._commanded = [float(rig.safe_state.get(name, 0.0)) for name in layout.commands]  # once open
        self._before: deque[tuple[float, int, float]] = deque(maxlen=_REMEMBERED)  # time, column, old value
        self._read: dict[str, float] = {}  # time of each device's newest reading, s
        self._limits: dict[str, float] = {}  # age at which a device's values are none any more, s
        self._changed = self._time = -math.inf

    def start(self, rate: float) -> None:
        """Take note of the rate at which the bench is sampled, Hz."""
        self._limits = {name: self._rig.silence_limit(name, rate) for name in self._rig.parts}

    def by_hand(self, actuator: str, value: float, time: float) -> None:
        """Take note of what the operator has been asked to set."""
        self._note(time, self._rig.layout.commands.index(actuator), value)

    def sample(self, device: str, sample: Sample, now: float) -> Sample:
        """Return the sample of the whole bench for a device's own one; `now` in s."""
        own = list(self._nothing)
        for column, value in zip(self._channels[device], sample.values, strict=True):
            own[column] = self._newest[column] = value
        for column, value in zip(self._commands[device], sample.commands, strict=True):
            self._note(sample.time, column, value)
        self._read[device] = sample.time
        self._time = max(self._time, sample.time)  # one that was long under way does not set the time back
        return Sample(
            self._time,
            self._values(now),
            tuple(self._commanded),
            Reading(device, sample.time, tuple(own), self._commands_at(sample.time)),
        )

    def _values(self, now: float) -> tuple[float, ...]:
        """Return the newest values that are not too old."""
        old = [name for name, time in self._read.items() if now - time > self._limits.get(name, math.inf)]
        if not old:
            return tuple(self._newest)
        values = list(self._newest)
        for column in (column for name in old for column in self._channels[name]):
            values[column] = math.nan
        return tuple(values)

    def _note(self, time: float, column: int, value: float) -> None:
        if value != self._commanded[column]:
            self._before.append((time, column, self._commanded[column]))
            self._changed = max(self._changed, time)
            self._commanded[column] = value

    def _commands_at(self, time: float) -> tuple[float, ...]:
        """Return the commands of all devices at a time, which later ones have replaced since."""
        if self._changed <= time:
            return tuple(self._commanded)
        commands = list(self._commanded)
        for when, column, before in reversed(self._before):
            if when > time:
                commands[column] = before
        return tuple(commands)
