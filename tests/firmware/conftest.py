"""The board's firmware on an emulated microcontroller, alone or behind a rig."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from rigctl.backends.emulated.avr import FREQUENCY, Avr
from rigctl.backends.emulated.board import millivolt
from rigctl.backends.emulated.image import read_intel_hex, shipped_image
from rigctl.files.shipped import shipped
from rigctl.rig import Rig, load_rig

if sys.platform != "linux":
    collect_ignore_glob = ["test_*.py"]  # simavr is packaged for Linux only

#: counts of A0, A1, A2 that no interlock minds
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

    def send(self, text: str, seconds: float = 0.03) -> list[str]:
        """Send lines and return the lines that come back meanwhile."""
        self.avr.send(text.encode("latin-1") + b"\n")
        self.run(seconds)
        return self.avr.take().decode("latin-1").splitlines()

    def ask(self, text: str) -> str:
        (answer,) = self.send(text)
        return answer


@pytest.fixture
def chip() -> Iterator[Chip]:
    made = Chip(shipped_image(115200))
    yield made
    made.avr.close()


@pytest.fixture
def make_chip() -> Iterator[Callable[[Path], Chip]]:
    made: list[Chip] = []

    def make(image: Path) -> Chip:
        made.append(Chip(image))
        return made[-1]

    yield make
    for one in made:
        one.avr.close()


@pytest.fixture(scope="session")
def uno_rig() -> Rig:
    return load_rig(shipped("rigs", "hl32-bench-uno.yaml"))
