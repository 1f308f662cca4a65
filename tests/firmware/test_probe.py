"""Identification of a port with the board's firmware."""

from __future__ import annotations

import pytest

from rigctl.backends.emulated.create import make_board
from rigctl.backends.emulated.port import EmulatedPort
from rigctl.backends.lines.probe import probe
from rigctl.backends.simulated.link import Link
from rigctl.clock import VirtualClock
from rigctl.rig import Rig


def test_the_board_is_identified_with_its_firmware_and_response_time(uno_rig: Rig) -> None:
    clock = VirtualClock()
    board = make_board(uno_rig, {"noise": "off"})
    try:
        found = probe(lambda: EmulatedPort(board, clock, -board.time, Link([])), clock, rounds=20)
    finally:
        board.close()
    assert found.question == "*IDN?"
    assert found.name.startswith("board with rigctl's firmware, RIG-UNO 1.")
    assert found.link.answered == 20
    assert found.link.slowest == pytest.approx(0.004, abs=0.002)
