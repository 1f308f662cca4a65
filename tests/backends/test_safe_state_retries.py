"""A guard that keeps trying to make a device safe, and its notices."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import time
from pathlib import Path

import pytest

from rigctl.backends.transport import safe_state_retries
from rigctl.backends.transport.address import Address
from rigctl.backends.transport.guard import GuardSettings
from rigctl.backends.transport.port import Port, PortLost
from rigctl.backends.transport.safe_commands import SafeOrder
from rigctl.backends.transport.safe_state_retries import Notice, SafeStateRetries, retrying_guards, take_over
from rigctl.clock import VirtualClock
from systems import needs_posix
from tclab_board import MemoryPort, Sketch

URL = "/dev/ttyACM0"
ADDRESS = Address("serial", URL, {"baud": 9600, "frame": "8N1"})
SAFE = (SafeOrder(b"X\n", ("{_}",)), SafeOrder(b"Q1 0.00\n", ("{value}",), {"value": ("0.00",)}))


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(safe_state_retries, "_folder", lambda: tmp_path / "guards")
    return tmp_path / "guards"


class Line:
    """A heating board whose plug is out for the first attempts."""

    def __init__(self, attempts: int) -> None:
        self.clock = VirtualClock()
        self.sketch = Sketch(self.clock.now)
        self.sketch.take(b"Q1 60\n")
        self.attempts = attempts

    def open(self) -> Port:
        self.attempts -= 1
        if self.attempts >= 0:
            raise PortLost("the plug is pulled")
        return MemoryPort(self.sketch, self.clock)

    def retry_until_safe(self) -> bool:
        orders = GuardSettings(ADDRESS, SAFE, 2.0)
        return SafeStateRetries(orders, self.clock, self.open, lambda: False).carry_out(None)


@pytest.mark.parametrize("obstacle", ["draft", "folder", "none"])
def test_a_guard_keeps_trying_when_its_notice_cannot_be_written(folder: Path, obstacle: str) -> None:
    if obstacle == "draft":  # the folder is there, and nothing can be written to it: as on a full disk
        safe_state_retries._path_of(ADDRESS.key).with_suffix(".tmp").mkdir(parents=True)
    elif obstacle == "folder":
        folder.write_text("no folder", encoding="utf-8")
    line = Line(3)
    assert line.retry_until_safe()
    assert line.sketch.heaters == (0.0, 0.0)
    assert retrying_guards() == []


def test_a_guard_stops_trying_when_its_notice_is_removed(folder: Path) -> None:
    line = Line(1000)
    opened = line.open

    def taken() -> Port:
        if line.attempts < 998:
            assert take_over(ADDRESS.key) is not None
        return opened()

    line.open = taken  # type: ignore[method-assign]
    assert not line.retry_until_safe()
    assert line.sketch.heaters == (60.0, 0.0)
    assert line.attempts == 996, "the attempt that found it gone was the last"


def test_a_device_exchanged_after_its_commands_is_not_taken_for_safe(folder: Path) -> None:
    """Another one answers to the second of the identity queries, and to the last one its own does again."""
    line, asked = Line(0), 0
    identify = SafeOrder(b"VER\n", ("TCLab Firmware {firmware}",))
    opened, take = line.open, line.sketch.take

    def taking(data: bytes) -> bytes:
        nonlocal asked
        asked += data.count(b"VER")
        return b"TCLab Firmware 2.0\r\n" if b"VER" in data and asked == 2 else take(data)

    line.sketch.take = taking  # type: ignore[method-assign]
    orders = GuardSettings(ADDRESS, SAFE, 2.0, identify=identify, identity={"firmware": "1.4.0 Arduino Uno"})
    assert SafeStateRetries(orders, line.clock, opened, lambda: False).carry_out(None)
    assert line.attempts == -2, "the port was opened again"
    assert (asked, line.sketch.received.count("X")) == (4, 2)


def test_a_guard_waits_for_an_answer_as_long_as_its_orders_say(folder: Path) -> None:
    line = Line(0)
    opened = line.open

    def slow() -> Port:
        port = opened()
        assert isinstance(port, MemoryPort)
        port.delay = 0.8
        return port

    orders = GuardSettings.from_json(GuardSettings(ADDRESS, SAFE, 2.0, timeout=1.0).to_json())
    assert SafeStateRetries(orders, line.clock, slow, lambda: False).carry_out(None)
    assert line.sketch.received == ["Q1 60", "X", "Q1 0.00"], "at the first attempt"


def leave(folder: Path, **fields: object) -> None:
    now = time.time()
    notice = {
        "token": "t",
        "port": URL,
        "pid": os.getpid(),
        "since": now - 90.0,
        "newest": now,
        "attempts": 7,
    }
    folder.mkdir(exist_ok=True)
    safe_state_retries._path_of(ADDRESS.key).write_text(json.dumps({**notice, **fields}), encoding="utf-8")


def said() -> str:
    (notice,) = retrying_guards()
    assert isinstance(notice, Notice)
    return str(notice)


def test_the_report_of_a_trying_guard_has_its_duration_and_number_of_attempts(folder: Path) -> None:
    leave(folder)
    assert re.search(r"has tried for \d+ s, 7 times, to make outputs safe on /dev/ttyACM0$", said())


@needs_posix("a process id that can be asked for by a signal")
def test_a_guard_without_a_process_has_stopped_trying(folder: Path) -> None:
    with subprocess.Popen([sys.executable, "-c", ""]) as gone:
        gone.wait()
    leave(folder, pid=gone.pid)
    assert "ended without success at 20" in said()
    assert "after 7 attempts to make outputs safe on /dev/ttyACM0" in said()
    assert "has tried" not in said()


def test_a_guard_whose_notice_is_old_is_reported_with_the_time_of_its_last_one(folder: Path) -> None:
    leave(folder, newest=time.time() - 3600.0)
    assert "was last heard of at 20" in said()


def test_a_guard_that_gave_up_is_reported(folder: Path) -> None:
    leave(folder, given_up=True)
    assert "ended without success at 20" in said()


@pytest.mark.parametrize("fields", [{"pid": "x"}, {"newest": None}, {"since": "x"}, {"newest": 1e300}])
def test_an_invalid_notice_is_ignored(folder: Path, fields: dict[str, object]) -> None:
    leave(folder, **fields)
    assert retrying_guards() == []
