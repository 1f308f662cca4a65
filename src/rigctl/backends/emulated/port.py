"""The emulated board's serial line within this process: reading advances the board with the clock."""

from __future__ import annotations

import math

from rigctl.backends.emulated.board import SLICE, EmulatedBoard
from rigctl.backends.simulated.link import Link
from rigctl.backends.transport.port import PortLost
from rigctl.clock import Clock


class EmulatedPort:
    """A `Port` that follows an injected clock.

    On a virtual clock two runs with the same seed and calls give identical bytes.

    Parameters
    ----------
    board: the board at the other end.
    clock: the clock of both sides.
    origin: bench time at which the board was switched on.
    link: the times at which the line is dead.
    """

    name = "the emulated board"

    def __init__(self, board: EmulatedBoard, clock: Clock, origin: float, link: Link) -> None:
        self._board = board
        self._clock = clock
        self._origin = origin
        self._link = link

    def write(self, data: bytes) -> None:
        """Send `data` now."""
        self._check()
        self._follow()
        self._board.avr.send(data)

    def read(self, until: float) -> bytes:
        """Return what the board has sent, waiting until bench time `until`."""
        while True:
            self._check()
            self._follow()
            data = self._board.avr.take()
            if data and not self._link.silent(self._clock.now() - self._origin):
                return data
            now = self._clock.now()
            if now >= until:
                return b""
            self._clock.sleep_until(min(until, now + SLICE))

    def close(self) -> None:
        """Close the port; the board keeps running."""

    def _follow(self) -> None:
        self._board.run_to(self._clock.now() - self._origin)

    def _check(self) -> None:
        now = self._clock.now() - self._origin
        if not self._link.perfect and self._link.back_at(now) > now:
            self._follow()
            self._board.avr.take()
            gone = "for good" if math.isinf(self._link.back_at(now)) else "for a while"
            raise PortLost(f"{self.name} cannot be reached: injected fault, {gone}")
