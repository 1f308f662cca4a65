"""Plays back a recorded run as a bench: returns its samples at their times, and acknowledges commands.

In: a `Recording`. Out: a `Backend`, with which a procedure can be run again on the measured data. Commands
change nothing; they only align the playback with the recording, since a wait may end one sample earlier or
later than it did.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np

from rigctl.backends.commands import check_command, driven_outputs
from rigctl.backends.errors import BackendLost
from rigctl.backends.protocol import CommandReceipt, Notice, PendingCommand, Sample
from rigctl.backends.replay.recording import Recording
from rigctl.clock import Clock
from rigctl.errors import RigctlError
from rigctl.rig import Rig

NEAR = 2.0  #: largest time between a command and the recorded one with which it is aligned, s
_BLOCK = 1024  # rows converted to tuples at once
_PATIENCE = 0.5  # fraction of the rig's stale_after: the end is reported before it looks like a silent bench


class Player:
    """A `Backend` that plays back a `Recording`.

    The first `start` begins the recording; samples arrive at their recorded intervals, regardless of the
    requested rate, with the commands in force at that time. New commands have no effect, but receipts are
    returned as by a bench that times its pulses.

    If the procedure of the recorded run is repeated, it receives the same samples, but a wait may end one
    sample earlier or later, since the recorded bench had a response time. A command that was also recorded
    within `NEAR` s therefore shifts the playback to the recorded one, so that a stroke begins when it is
    commanded.

    Parameters
    ----------
    rig: the channels and actuators.
    clock: the clock for waits.
    load: reads the recording when the bench is opened.
    identity: the identity of the bench.
    """

    timed = True
    without_host = "a recording has no outputs"

    def __init__(
        self, rig: Rig, clock: Clock, load: Callable[[], Recording], identity: Mapping[str, str]
    ) -> None:
        self.clock = clock
        self.identity: Mapping[str, str] = {"kind": "replay", "name": rig.name, **identity}
        self._rig = rig
        self._load = load
        self._recording: Recording | None = None
        self._origin: float | None = None  # clock time of the first sample
        self._index = 0
        self._rows: list[
            tuple[float, list[float], list[float]]
        ] = []  # the block being played, last row first
        self._pulse_ends: dict[str, float] = {}
        self._passed = 0  # switches of the recording that have been matched

    @property
    def outputs_read(self) -> frozenset[str]:
        """All driven outputs."""
        return driven_outputs(self._rig)

    @property
    def outputs_answered(self) -> frozenset[str]:
        """All driven outputs."""
        return driven_outputs(self._rig)

    def open(self) -> None:
        """Read the recording."""
        self._recording = self._load()
        self._origin = None
        self._index = 0
        self._rows.clear()
        self._pulse_ends.clear()
        self._passed = 0

    def close(self) -> None:
        """Release the recording."""
        self._recording = None

    def start(self, rate: float) -> None:
        """Start or continue the playback; `rate` is only checked."""
        self._opened()
        if not (math.isfinite(rate) and rate > 0.0):
            raise RigctlError("not a sampling rate", value=f"{rate:g} Hz", expected="e.g. '100 Hz'")
        if self._origin is None:
            self._origin = self.clock.now()

    def next_sample(self, timeout: float) -> Sample | None:
        """Return the next recorded sample, at its time.

        Raises
        ------
        BackendLost
            the recording ended some time ago; not at once, so that a wait in progress at its end can finish.
        """
        recording = self._opened()
        deadline = self.clock.now() + timeout
        if self._origin is None:
            self.clock.sleep_until(deadline)
            return None
        if not self._rows:
            self._rows = self._next_rows(recording)
        if not self._rows:
            self._wait_at_end(self._origin + float(recording.times[-1]), deadline)
            return None
        when = self._origin + self._rows[-1][0]
        if when > deadline:
            self.clock.sleep_until(deadline)
            return None
        self.clock.sleep_until(when)
        _, values, commands = self._rows.pop()
        return Sample(when, tuple(values), tuple(commands))

    def command(self, actuator: str, value: float, *, duration: float | None = None) -> PendingCommand:
        """Acknowledge a command."""
        recording = self._opened()
        check_command(self._rig, actuator, value, duration)
        now = self.clock.now()
        self._align(recording, actuator, value, now)
        self._pulse_ends.pop(actuator, None)
        if duration is not None:
            self._pulse_ends[actuator] = now + duration
        return PendingCommand.answered(CommandReceipt(now, actuator, value))

    def take_receipts(self) -> list[CommandReceipt]:
        """Return the ends of pulses since the last call."""
        self._opened()
        now = self.clock.now()
        ended = sorted((end, actuator) for actuator, end in self._pulse_ends.items() if end <= now)
        for _, actuator in ended:
            del self._pulse_ends[actuator]
        return [
            CommandReceipt(end, actuator, float(self._rig.safe_state[actuator])) for end, actuator in ended
        ]

    def take_notices(self) -> list[Notice]:
        """Return no notices."""
        return []

    def safe(self) -> None:
        """Discard pulses; nothing can move."""
        self._opened()
        self._pulse_ends.clear()

    def _opened(self) -> Recording:
        if self._recording is None:
            raise BackendLost("the recording is not open")
        return self._recording

    def _align(self, recording: Recording, actuator: str, value: float, now: float) -> None:
        """Shift the playback to the same command in the recording, if there is one within `NEAR` s."""
        if self._origin is None:
            return
        position = now - self._origin
        for index in range(self._passed, len(recording.switches)):
            switch = recording.switches[index]
            if switch.time > position + NEAR:
                return
            if switch.time >= position - NEAR and (switch.actuator, switch.value) == (actuator, value):
                # In order only: a switch that was matched, or passed over, is never matched again.
                self._passed = index + 1
                self._origin = now - switch.time
                self._index = int(np.searchsorted(recording.times, switch.time, side="right"))
                self._rows.clear()
                return

    def _next_rows(self, recording: Recording) -> list[tuple[float, list[float], list[float]]]:
        part = slice(self._index, self._index + _BLOCK)
        times = recording.times[part].tolist()
        self._index += len(times)
        rows = zip(times, recording.values[part].tolist(), recording.commands[part].tolist(), strict=True)
        return list(rows)[::-1]

    def _wait_at_end(self, last: float, deadline: float) -> None:
        """Wait without samples until `_PATIENCE` of the time after which silence counts as a fault."""
        given_up = last + _PATIENCE * self._rig.tolerated_silence
        self.clock.sleep_until(min(deadline, given_up))
        if deadline >= given_up:
            raise BackendLost(
                f"the recording ended at {last:g} s",
                hint="Play it with the procedure that it was recorded with",
            )
