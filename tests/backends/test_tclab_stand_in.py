"""The stand-in of the heater board is faithful: the board's own Python client works with it."""

from __future__ import annotations

import time
from types import SimpleNamespace

import pytest

from systems import needs_posix
from tclab_board import VERSION, Served


@needs_posix("a pseudo-terminal")
def test_the_python_client_of_the_board_works_with_the_stand_in(monkeypatch: pytest.MonkeyPatch) -> None:
    import tclab.tclab as client

    with Served(pty=True) as board:
        monkeypatch.setattr(client, "find_arduino", lambda port="": (board.url, "Arduino Uno"))
        monkeypatch.setattr(client, "_connected", False)
        monkeypatch.setattr(client, "time", SimpleNamespace(sleep=lambda _: None, time=time.time))
        with client.TCLab() as lab:
            assert lab.version == VERSION
            assert lab.Q1(120) == 100.0
            assert lab.Q2(12.5) == 12.5
            assert board.sketch.heaters == (100.0, 12.5)
            temperature = lab.T1
            assert temperature == pytest.approx(21.0, abs=1.0)
            assert lab.scan()[2:] == (100.0, 12.5)
        assert board.sketch.heaters == (0.0, 0.0)
        assert "X" in board.sketch.received
