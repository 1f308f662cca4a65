"""Signals that ask a run to end."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator

import pytest

from rigctl.runner.operators.signals import Signals

pytestmark = pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="needs SIGHUP")


@pytest.fixture
def hang_up() -> Iterator[int]:
    """The number of SIGHUP, whose handler is restored afterwards."""
    number = int(getattr(signal, "SIGHUP", 0))
    before = signal.getsignal(number)
    yield number
    signal.signal(number, before)


def test_a_closed_terminal_is_counted(hang_up: int) -> None:
    signal.signal(hang_up, signal.SIG_DFL)
    with Signals() as signals:
        os.kill(os.getpid(), hang_up)
        assert (signals.count, signals.name) == (1, "SIGHUP")


def test_a_run_started_with_nohup_survives_its_terminal(hang_up: int) -> None:
    signal.signal(hang_up, signal.SIG_IGN)
    with Signals() as signals:
        os.kill(os.getpid(), hang_up)
        assert signals.count == 0
    assert signal.getsignal(hang_up) is signal.SIG_IGN
