"""What the board sends of its own accord, turned into samples, receipts and notices."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

from rigctl.backends.protocol import CommandReceipt, Notice, Sample
from rigctl.backends.serial.board import Board, trip_causes
from rigctl.backends.serial.messages import Reading, Switched
from rigctl.backends.serial.translation import Translation
from rigctl.clock import Clock

_NUMBERS = 1 << 16
_FIRST_NUMBERS = 4096  # of a stream that has just begun: 2 s at the highest rate
_NOTHING_ELSE = 5  # damaged lines, and no whole one between them


class Intake:
    """Checks sequence numbers, puts the board's times on the bench's clock, and keeps what came.

    Attributes
    ----------
    samples, receipts, notices: what has not been fetched yet.
    commanded: what each actuator was told last, SI; what the board reports is entered here as well.
    tripped: why the board has switched off; empty while it has not.
    heard: when the stream was heard last, s.
    wanted: whether anybody has asked for samples.
    restarting: whether the board has been asked to begin its stream anew, and has not answered yet.
    """

    def __init__(self, translation: Translation, clock: Clock) -> None:
        self._translation = translation
        self._clock = clock
        self._sequence: int | None = None
        self._damaged = self._damaged_when_heard = 0
        self._told_of_damage = False
        self._last_time = -math.inf
        self.samples: deque[Sample] = deque()
        self.receipts: list[CommandReceipt] = []
        self.notices: list[Notice] = []
        self.commanded: dict[str, float] = {}
        self.tripped = ""
        self.heard = 0.0
        self.wanted = False
        self.restarting = False

    def restart(self, board: Board, before: int) -> None:
        """The board says that its stream has begun anew; `before` readings that wait are of the old one."""
        for _ in range(min(before, len(board.line.readings))):
            self._take_reading(board, board.line.readings.popleft())
        self._sequence = None
        self.restarting = False
        self._damaged = self._damaged_when_heard = board.line.damaged
        self.heard = self._clock.now()

    def take(self, board: Board) -> None:
        """Take everything that has arrived."""
        line = board.line
        while line.switched:
            self.take_switched(board, line.switched.popleft())
        while line.readings:
            self._take_reading(board, line.readings.popleft())
        if line.damaged > self._damaged:
            more, self._damaged = line.damaged - self._damaged, line.damaged
            self.notice("note", f"{more} damaged line{'' if more == 1 else 's'} left out", lines=more)
            if not self._told_of_damage and line.damaged - self._damaged_when_heard >= _NOTHING_ELSE:
                self._told_of_damage = True
                self.notice("fault", "what arrives from the board are damaged lines only")

    def take_switched(self, board: Board, event: Switched) -> None:
        """A switch that nobody here has just commanded: the end of a pulse, or a trip."""
        time = board.clock_map.to_host(event.board_us)
        if event.kind == "T":
            if event.value:
                self._trip(time, event.value)
            return
        actuator = self._translation.actuator_of(event.kind)
        if actuator is None:
            return
        value = self._translation.value(actuator, event.value)
        self.commanded[actuator] = value
        self.receipts.append(CommandReceipt(time, actuator, value, board.clock_map.uncertainty))

    def notice(self, kind: str, message: str, *, time: float | None = None, **fields: object) -> None:
        """Something that belongs into the run's events, now unless another time is given."""
        self.notices.append(Notice(self._clock.now() if time is None else time, kind, message, fields))

    def gap(self, missing: int, *, cause: str = "", switched_off: Sequence[str] = ()) -> None:
        """Samples that will not come, and what was switched off meanwhile without being told to."""
        now = self._clock.now()
        text = f"{missing} sample{'' if missing == 1 else 's'} missing before {now:.3f} s"
        if cause:
            text += f": {cause}"
        if not switched_off:
            self.notice("gap", text, samples=missing)
            return
        text += f"; meanwhile {', '.join(switched_off)} went to the safe state"
        self.notice("gap", text, samples=missing, switched_off=list(switched_off))

    def damage_since_heard(self, board: Board) -> str:
        """What has arrived instead of samples, for a message."""
        damaged = board.line.damaged - self._damaged_when_heard
        return f"; {damaged} damaged lines came since the last whole one" if damaged > 1 else ""

    def missing_since(self, lost_at: float, rate: float) -> int:
        """How many samples a loss of the line has cost by now, at the least one."""
        since = self._last_time if math.isfinite(self._last_time) else lost_at
        return max(1, round((self._clock.now() - since) * rate) - 1)

    def _trip(self, time: float, causes: int) -> None:
        text = ", ".join(trip_causes(causes))
        if text != self.tripped:
            self.tripped = text
            self.notice("alarm", f"the board has tripped: {text}", time=time, trips=causes)

    def _take_reading(self, board: Board, reading: Reading) -> None:
        self.heard = self._clock.now()
        self._damaged_when_heard = board.line.damaged
        self._told_of_damage = False
        step = 1 if self._sequence is None else (reading.sequence - self._sequence) % _NUMBERS
        time = board.clock_map.to_host(reading.board_us)
        old = step == 0 or step > _NUMBERS // 2
        if old and self.restarting and reading.sequence < _FIRST_NUMBERS and time > self._last_time:
            old, step = False, 1  # begun anew, and the answer that says so is late or lost
        if old:
            self.notice("note", f"sample {reading.sequence} came twice or late, left out")
            return
        if step > 1:
            self.gap(step - 1)
        self._sequence = reading.sequence
        if reading.trips:
            self._trip(time, reading.trips)
        if not self.wanted or time <= self._last_time:
            return
        self._last_time = time
        translation = self._translation
        self.samples.append(
            Sample(time, translation.values(reading), translation.commands(reading, self.commanded))
        )
