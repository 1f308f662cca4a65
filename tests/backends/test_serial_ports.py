"""Serial ports: the probable device, permissions, and the identity."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest

from rigctl.backends.lines.probe import probe
from rigctl.backends.transport import serial_ports as ports
from rigctl.backends.transport.port import PortLost
from rigctl.backends.transport.pyserial_port import PyserialPort
from rigctl.clock import VirtualClock, real_clock
from rigctl.errors import RigctlError
from systems import listed_ports, needs_posix
from tclab_board import VERSION, MemoryPort, Sketch


def comport(device: str, vendor: int | None = None, product: int | None = None) -> SimpleNamespace:
    return SimpleNamespace(device=device, description="n/a", vid=vendor, pid=product, serial_number=None)


@pytest.mark.parametrize(
    ("vendor", "product", "guess"),
    [
        (0x2341, 0x0043, "Arduino Uno"),
        (0x2341, 0xFFFF, "Arduino"),
        (0x1A86, 0x7523, "CH340"),
        (0x0403, 0x6001, "FT232R"),
        (0x1234, 0x5678, ""),
        (None, None, ""),
    ],
)
def test_the_device_on_a_port_is_guessed(vendor: int | None, product: int | None, guess: str) -> None:
    found = ports.guess(vendor, product)
    assert found.startswith(guess)
    assert bool(found) == bool(guess)


def test_usb_ports_come_first(monkeypatch: pytest.MonkeyPatch) -> None:
    there = [
        comport("/dev/ttyS0"),
        comport("/dev/ttyUSB0", 0x1A86, 0x7523),
        comport("/dev/ttyACM0", 0x2341, 0x43),
    ]
    listed_ports(monkeypatch, lambda: there)
    found = ports.list_ports()
    assert [port.device for port in found] == ["/dev/ttyACM0", "/dev/ttyUSB0", "/dev/ttyS0"]
    assert [port.usb for port in found] == ["2341:0043", "1A86:7523", ""]


@needs_posix("groups of users that may open ports")
@pytest.mark.parametrize(
    ("members", "mode", "fix"),
    [
        ([], 0o660, "sudo usermod -aG dialout $USER"),
        (["ada"], 0o660, "log out and in again"),
        ([], 0o600, "sudo chmod a+rw"),
    ],
)
def test_missing_permission_is_reported_with_the_command_to_get_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, members: list[str], mode: int, fix: str
) -> None:
    import grp

    device = tmp_path / "ttyACM0"
    device.touch()
    device.chmod(mode)
    group = SimpleNamespace(gr_name="dialout", gr_mem=members)
    monkeypatch.setattr(os, "access", lambda *_: False)
    monkeypatch.setattr(grp, "getgrgid", lambda _: group)
    monkeypatch.setattr(grp, "getgrnam", lambda _: group)
    monkeypatch.setenv("LOGNAME", "ada")
    accessible, told = ports.access_to(str(device))
    assert not accessible
    assert told.startswith(fix)


@pytest.mark.parametrize("system", ["win32", "darwin", "linux"])
def test_each_system_has_its_own_advice(monkeypatch: pytest.MonkeyPatch, system: str) -> None:
    monkeypatch.setattr(ports.sys, "platform", system)
    assert "cable" in ports.missing_port_fix()


@pytest.fixture
def board() -> MemoryPort:
    clock = VirtualClock()
    return MemoryPort(Sketch(clock.now), clock)


def connect(port: MemoryPort) -> Callable[[], MemoryPort]:
    return lambda: port


def test_the_heater_board_is_identified_by_its_version(board: MemoryPort) -> None:
    found = probe(connect(board), board.clock, rounds=20)
    assert (found.question, found.identity) == ("VER", VERSION)
    assert found.name == f"two-heater board, {VERSION}"
    assert (found.link.asked, found.link.answered, found.link.damaged) == (20, 20, 0)
    assert found.link.median == pytest.approx(0.01)
    assert board.closed


def test_a_bad_line_is_detected_from_its_answers(board: MemoryPort) -> None:
    wrong = iter([False] * 8 + [True, False] * 6)
    answer = board.sketch._answer

    def disturbed(line: str) -> bytes:
        whole = answer(line)
        return whole.replace(b"Firmware", b"Firm\xffare") if line == "VER" and next(wrong, False) else whole

    board.sketch._answer = disturbed  # type: ignore[method-assign]
    link = probe(connect(board), board.clock, rounds=20).link
    assert link.damaged == 6
    assert link.answered == 14


def test_no_answer_is_reported_after_the_start_time_of_a_board(board: MemoryPort) -> None:
    board.mute = True
    with pytest.raises(PortLost, match="nobody answers"):
        probe(connect(board), board.clock)
    assert 3.0 < board.clock.now() < 5.0
    assert board.closed


def test_a_slowly_starting_board_is_identified(board: MemoryPort) -> None:
    board.mute = True
    write = board.write

    def waking(data: bytes) -> None:
        board.mute = board.clock.now() < 1.9
        write(data)

    board.write = waking  # type: ignore[method-assign]
    assert probe(connect(board), board.clock, rounds=3).identity == VERSION


@pytest.mark.parametrize(
    "url", ["spy:///dev/ttyS0?file={folder}/spied.txt", "alt://x?class=Serial", "cp2110://0"]
)
def test_a_port_that_does_more_than_connect_is_refused(tmp_path: Path, url: str) -> None:
    with pytest.raises(RigctlError, match="not a kind of port"):
        PyserialPort(url.format(folder=tmp_path), 115200, VirtualClock())
    assert list(tmp_path.iterdir()) == []


def test_a_wait_that_a_driver_ends_with_an_error_is_no_lost_port(monkeypatch: pytest.MonkeyPatch) -> None:
    """Windows' number for a time-out; any other error of the same function is a lost port."""
    import serial

    class Driver:
        timeout = 0.0
        in_waiting = 0
        number = 1460

        def read(self, _size: int) -> bytes:
            text = f"GetOverlappedResult failed (OSError(22, 'Timeout.', None, {self.number}))"
            raise serial.SerialException(text)

    driver = Driver()
    monkeypatch.setattr(serial, "serial_for_url", lambda *_, **__: driver)
    port = PyserialPort("COM3", 115200, real_clock())
    assert port.read(0.0) == b""
    driver.number = 5
    with pytest.raises(PortLost, match="COM3"):
        port.read(0.0)
