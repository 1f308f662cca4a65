"""The board's firmware on an emulated microcontroller, alone or behind a rig."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from board_chip import Chip
from rigctl.backends.emulated.image import shipped_image
from rigctl.files.shipped import shipped
from rigctl.rig import Rig, load_rig

if sys.platform != "linux":
    collect_ignore_glob = ["test_*.py"]  # simavr is packaged for Linux only


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
