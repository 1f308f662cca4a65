"""The board's microcontroller with its firmware, without a host: for its tests and its benchmark."""

from __future__ import annotations

from pathlib import Path

from rigctl.backends.emulated.avr import FREQUENCY, Avr
from rigctl.backends.emulated.board import millivolt
from rigctl.backends.emulated.image import read_intel_hex

#: counts of A0, A1, A2 within all interlock limits
NORMAL = (200, 500, 300)


class Chip:
    """One microcontroller with the firmware, its inputs at fixed counts, time under control."""

    def __init__(self, image: Path) -> None:
        self.edges: list[tuple[float, str, bool]] = []
        names = {("D", 4): "heater", ("D", 7): "extend", ("B", 0): "retract"}

        def changed(port: str, bit: int, level: bool, cycle: int) -> None:
            if (port, bit) in names and level != self.pins[names[port, bit]]:
                self.pins[names[port, bit]] = level
                self.edges.append((cycle / FREQUENCY, names[port, bit], level))

        self.pins = dict.fromkeys(names.values(), False)
        self.avr = Avr(read_intel_hex(image), changed)
        self.put(*NORMAL)
        self.run(0.02)

    @property
    def time(self) -> float:
        return self.avr.cycle / FREQUENCY

    def put(self, *counts: int) -> None:
        for channel, code in enumerate(counts):
            self.avr.put_voltage(channel, millivolt(code))

    def run(self, seconds: float) -> None:
        self.avr.run_to(self.avr.cycle + round(seconds * FREQUENCY))

    def tell(self, text: str) -> None:
        """Send lines; the answers remain in the buffer."""
        self.avr.send(text.encode("latin-1") + b"\n")

    def send(self, text: str, seconds: float = 0.03) -> list[str]:
        """Send lines and return the lines that come back meanwhile."""
        self.tell(text)
        self.run(seconds)
        return self.avr.take().decode("latin-1").splitlines()

    def ask(self, text: str) -> str:
        (answer,) = self.send(text)
        return answer
