"""The emulated board on a pseudo-terminal, in another thread, in real time."""

from __future__ import annotations

import threading
from pathlib import Path

from rigctl.backends.arduino.wiring import wiring_of
from rigctl.backends.emulated.board import EmulatedBoard
from rigctl.backends.emulated.image import read_intel_hex, shipped_image
from rigctl.backends.emulated.pty_bridge import PtyBridge
from rigctl.backends.simulated.create import prepare
from rigctl.clock import real_clock
from rigctl.rig import Rig


class Emulation:
    """A board on a pty, running until it is stopped; its plug can be pulled and put back.

    A stalled computer stops the board, too, so tests compare times of the board.

    Attributes
    ----------
    heard: board time of the last bytes from a host, s.
    switched: board time of each switch of an output, s, and the outputs from then on.
    """

    def __init__(self, rig: Rig, name: Path) -> None:
        device = prepare(rig, {"plant": "roles", "noise": "off", "seed": 1}).switch_on()
        self.board = EmulatedBoard(rig, wiring_of(rig, {}), read_intel_hex(shipped_image(115200)), device)
        self.heard = 0.0
        self.switched: list[tuple[float, tuple[bool, bool, bool]]] = []
        self._witness()
        self.name = name
        self._clock = real_clock()
        self._end = threading.Event()
        self.plug()

    def _witness(self) -> None:
        board, send, switch = self.board, self.board.avr.send, self.board._switch

        def hear(data: bytes) -> None:
            self.heard = board.time
            send(data)

        def see(time: float, pin: tuple[str, int]) -> None:
            switch(time, pin)
            self.switched.append((time, board.outputs))

        board.avr.send = hear  # type: ignore[method-assign]
        board._switch = see  # type: ignore[method-assign]

    def plug(self) -> None:
        self._end.clear()
        self._bridge = PtyBridge(self.board, self._clock)
        self._bridge.link(self.name)
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def unplug(self) -> None:
        self._end.set()
        self._thread.join()
        self._bridge.close()
        self.name.unlink()

    def close(self) -> None:
        if self.name.is_symlink():
            self.unplug()
        self.board.close()

    def _run(self) -> None:
        while not self._end.is_set():
            self._bridge.step()
