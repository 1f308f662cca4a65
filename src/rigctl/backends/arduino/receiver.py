"""Converts the board's unsolicited messages to samples, receipts and notices."""

from __future__ import annotations

import math

from rigctl.backends.arduino.board import Board, trip_causes
from rigctl.backends.arduino.messages import Reading, Switched
from rigctl.backends.arduino.translation import Translation
from rigctl.backends.protocol import CommandReceipt, Sample
from rigctl.backends.transport.outbox import Outbox
from rigctl.clock import Clock
from rigctl.wording import number_of

_NUMBERS = 1 << 16
_FIRST_NUMBERS = 4096  # sequence numbers taken as those of a new stream: 2 s at the highest rate
_NOTHING_ELSE = 5  # consecutive damaged lines after which a fault is reported


class Receiver:
    """Checks sequence numbers, converts times to the bench's clock, and fills the outbox.

    Attributes
    ----------
    tripped: the cause for which the board has switched off its outputs; empty if it has not.
    heard: time of the last message of the stream, s.
    wanted: whether samples were requested.
    restarting: whether a restart of the stream has been requested and not yet confirmed.
    looping: time of the newest reading, s, and whether a closed loop was running on the board then.
    """

    def __init__(self, translation: Translation, clock: Clock, outbox: Outbox) -> None:
        self._translation = translation
        self._clock = clock
        self._outbox = outbox
        self._sequence: int | None = None
        self._damaged = self._damaged_when_heard = 0
        self._told_of_damage = False
        self._last_time = -math.inf
        self.tripped = ""
        self.heard = 0.0
        self.wanted = False
        self.restarting = False
        self.looping = (-math.inf, False)

    def restart(self, board: Board, before: int) -> None:
        """Handle a restart of the board's stream; the first `before` queued readings are from the old one."""
        for _ in range(min(before, len(board.line.readings))):
            self._take_reading(board, board.line.readings.popleft())
        self._sequence = None
        self.restarting = False
        self._damaged = self._damaged_when_heard = board.line.damaged
        self.heard = self._clock.now()

    def take(self, board: Board) -> None:
        """Process everything that has arrived."""
        line = board.line
        # Switches before readings: a command that ended by itself is known before the sample that shows it.
        while line.switched:
            self.take_switched(board, line.switched.popleft())
        while line.readings:
            self._take_reading(board, line.readings.popleft())
        if line.damaged > self._damaged:
            more, self._damaged = line.damaged - self._damaged, line.damaged
            self._outbox.notice("note", f"{number_of(more, 'damaged line')} left out", lines=more)
            if not self._told_of_damage and line.damaged - self._damaged_when_heard >= _NOTHING_ELSE:
                self._told_of_damage = True
                self._outbox.notice("fault", "what arrives from the board are damaged lines only")

    def take_switched(self, board: Board, event: Switched) -> None:
        """Process a switch without a pending command: the end of a pulse, or a trip."""
        time = board.clock_map.to_host(event.board_us)
        if event.kind == "T":
            if event.value:
                self._trip(time, event.value)
            return
        actuator = self._translation.actuator_of(event.kind)
        if actuator is None:
            return
        value = self._translation.value(actuator, event.value)
        self._outbox.commanded[actuator] = value
        self._outbox.receipts.append(CommandReceipt(time, actuator, value, board.clock_map.uncertainty))

    def damage_since_heard(self, board: Board) -> str:
        """Return a clause on the damaged lines since the last valid one; empty if there is at most one."""
        damaged = board.line.damaged - self._damaged_when_heard
        return f"; {damaged} damaged lines came since the last whole one" if damaged > 1 else ""

    def missing_since(self, lost_at: float, rate: float) -> int:
        """Return the number of samples lost since contact was lost at `lost_at`, at least one."""
        since = self._last_time if math.isfinite(self._last_time) else lost_at
        return max(1, round((self._clock.now() - since) * rate) - 1)

    def _trip(self, time: float, causes: int) -> None:
        text = ", ".join(trip_causes(causes))
        if text != self.tripped:
            self.tripped = text
            self._outbox.notice("alarm", f"the board has tripped: {text}", time=time, trips=causes)

    def _take_reading(self, board: Board, reading: Reading) -> None:
        self.heard = self._clock.now()
        self._damaged_when_heard = board.line.damaged
        self._told_of_damage = False
        # The difference modulo 2^16: small is a gap, more than half of it is a number from before.
        step = 1 if self._sequence is None else (reading.sequence - self._sequence) % _NUMBERS
        time = board.clock_map.to_host(reading.board_us)
        old = step == 0 or step > _NUMBERS // 2
        if old and self.restarting and reading.sequence < _FIRST_NUMBERS and time > self._last_time:
            old, step = False, 1  # the stream has restarted; its confirmation is late or lost
        if old:
            self._outbox.notice("note", f"sample {reading.sequence} came twice or late, left out")
            return
        if step > 1:
            self._outbox.gap(step - 1)
        self._sequence = reading.sequence
        if reading.trips:
            self._trip(time, reading.trips)
        self._note_loop(board, time, reading)
        # Readings that nobody asked for still keep the sequence, trips and loop up to date.
        if not self.wanted or time <= self._last_time:
            return
        self._last_time = time
        translation = self._translation
        self._outbox.samples.append(
            Sample(time, translation.values(reading), translation.commands(reading, self._outbox.commanded))
        )

    def _note_loop(self, board: Board, time: float, reading: Reading) -> None:
        """Record the output of a closed loop on the board, at the time of its change."""
        self.looping = (time, reading.pwm is not None)
        actuator = self._translation.actuator_of("P")
        if reading.pwm is None or actuator is None:
            return
        value = self._translation.value(actuator, reading.pwm)
        if self._outbox.commanded.get(actuator) != value:
            self._outbox.commanded[actuator] = value
            changed = time - reading.held_us * 1e-6
            self._outbox.receipts.append(
                CommandReceipt(changed, actuator, value, board.clock_map.uncertainty)
            )
