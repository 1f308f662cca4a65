"""After a loss of contact a serial port is opened only if the same USB adapter is behind it."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pytest
from serial.tools.list_ports_common import ListPortInfo

from rigctl.backends.transport.adapter import same_adapter
from rigctl.errors import RigctlError
from systems import listed_ports


class Bus:
    """Serial ports of a computer, by device, and the opened ones."""

    def __init__(self, **numbers: str | None) -> None:
        self.numbers = {f"/dev/{name}": number for name, number in numbers.items()}
        self.opened: list[str] = []

    def comports(self) -> list[ListPortInfo]:
        found = []
        for device, number in self.numbers.items():
            port = ListPortInfo(device)
            port.serial_number = number
            found.append(port)
        return found

    def connect_to(self, device: str) -> Any:
        def connect() -> Any:
            self.opened.append(device)
            return device

        return same_adapter(connect, device)


@pytest.fixture
def bus(monkeypatch: pytest.MonkeyPatch) -> Bus:
    found = Bus(ttyACM0="A1", ttyACM1="B2", ttyUSB0=None)
    listed_ports(monkeypatch, found.comports)
    return found


def test_two_boards_that_have_exchanged_their_names_are_not_confused(bus: Bus) -> None:
    connect = bus.connect_to("/dev/ttyACM0")
    connect()
    bus.numbers = {"/dev/ttyACM0": "B2", "/dev/ttyACM1": "A1"}
    with pytest.raises(RigctlError, match="another USB adapter is on this port than before") as refused:
        connect()
    assert "serial number B2" in str(refused.value)
    assert "serial number A1, which is /dev/ttyACM1 now" in str(refused.value)
    assert bus.opened == ["/dev/ttyACM0"]  # opening it would restart the other board
    bus.numbers = {"/dev/ttyACM0": "A1"}
    connect()
    assert bus.opened == ["/dev/ttyACM0"] * 2


@pytest.mark.parametrize("device", ["/dev/ttyACM0", "/dev/ttyUSB0", "socket://127.0.0.1:5025"])
def test_the_same_adapter_or_one_without_a_number_is_opened_again(bus: Bus, device: str) -> None:
    connect = bus.connect_to(device)
    assert [connect(), connect()] == [device] * 2


def test_an_adapter_that_has_only_just_appeared_is_opened(bus: Bus) -> None:
    connect = bus.connect_to("/dev/ttyACM0")
    connect()
    bus.numbers = {}  # the system does not list it yet
    connect()
    assert len(bus.opened) == 2


def test_a_port_is_opened_by_its_name_where_the_system_cannot_list_its_ports(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def broken() -> None:
        raise AttributeError("function 'CM_Get_Parent' not found")

    listed_ports(monkeypatch, broken)
    connect = same_adapter(lambda: "COM3", "COM3")  # type: ignore[arg-type,return-value]
    assert [connect(), connect()] == ["COM3"] * 2


@pytest.mark.skipif(sys.platform == "win32", reason="Windows permits links to administrators only")
def test_a_link_to_a_port_is_followed(bus: Bus, tmp_path: Path) -> None:
    link = tmp_path / "bench"
    link.symlink_to("/dev/ttyACM0")
    connect = bus.connect_to(str(link))
    connect()
    bus.numbers = {"/dev/ttyACM0": "B2"}
    with pytest.raises(RigctlError, match="another USB adapter"):
        connect()
