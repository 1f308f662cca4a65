"""All spellings of one address have one key, and no two devices share one."""

from __future__ import annotations

import os
import re
import socket
from pathlib import Path

import pytest

from rigctl.backends.registry import address_of
from rigctl.backends.transport.address_key import address_key, file_name
from rigctl.backends.transport.pyserial_port import open_port
from rigctl.clock import ScaledClock
from rigctl.errors import RigctlError
from rigctl.files.shipped import shipped
from rigctl.rig import load_rig
from systems import needs_posix


@pytest.mark.parametrize(
    ("kind", "spellings"),
    [
        ("modbus", ["127.0.0.1:502", "localhost:502", "tcp://localhost", "LOCALHOST:502", "[::1]:502"]),
        ("modbus", ["192.168.0.20:1502", "tcp://192.168.0.20:1502", "[::ffff:192.168.0.20]:1502"]),
        ("serial", ["socket://127.0.0.1:7018", "socket://localhost:7018", "SOCKET://Localhost:7018/"]),
        ("serial", ["rfc2217://localhost:2217", "rfc2217://127.0.0.1:2217?logging=debug"]),
        ("visa", ["TCPIP::10.0.0.1::5025::SOCKET", "TCPIP0::10.0.0.1::5025::socket"]),
        ("visa", ["TCPIP::10.0.0.1::INSTR", "TCPIP0::10.0.0.1::inst0::INSTR", "tcpip::10.0.0.1"]),
        ("visa", ["USB0::0x0957::0x0507::MY44::INSTR", "USB::2391::1287::MY44::0::INSTR"]),
        ("visa", ["GPIB0::9::INSTR", "GPIB::9", "gpib0::09::instr"]),
        ("opcua", ["opc.tcp://localhost:4840", "opc.tcp://127.0.0.1", "opc.tcp://LOCALHOST:4840/"]),
        ("opcua", ["opc.tcp://10.0.0.2:4840/plant/", "OPC.TCP://10.0.0.2/plant"]),
        ("epics", ["localhost:5064", "127.0.0.1:5064"]),
    ],
)
def test_the_spellings_of_one_address_have_one_key(kind: str, spellings: list[str]) -> None:
    assert len({address_key(kind, text) for text in spellings}) == 1


def test_the_key_of_a_plugin_s_device_does_not_depend_on_the_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = [address_key("canbus", url) for url in ("socketcan:can0", "bench-7", "10.0.0.2:5064")]
    monkeypatch.chdir(tmp_path)
    assert [address_key("canbus", url) for url in ("socketcan:can0", "bench-7", "10.0.0.2:5064")] == before
    assert len({*before, address_key("other", "bench-7")}) == 4
    for url in ("COM7", "rfc2217://localhost:2217"):  # the port itself is what is shared
        assert address_key("canbus", url) == address_key("serial", url)


def test_different_devices_have_different_keys() -> None:
    addresses = [
        *(("modbus", text) for text in ("10.0.0.1:502", "10.0.0.1:503", "10.0.0.2:502", "/dev/ttyUSB7")),
        *(("visa", text) for text in ("TCPIP::10.0.0.1::INSTR", "TCPIP::10.0.0.1::inst1::INSTR", "GPIB0::9")),
        *(("visa", text) for text in ("GPIB1::9", "GPIB0::9::1", "USB0::1::2::A", "USB0::1::2::B")),
        *(("opcua", text) for text in ("opc.tcp://10.0.0.1", "opc.tcp://10.0.0.1/b", "opc.tcp://10.0.0.3")),
        *(("serial", text) for text in ("socket://10.0.0.1:7018", "/dev/ttyACM0", "COM3", "loop://")),
    ]
    keys = {address_key(kind, text) for kind, text in addresses}
    assert len(keys) == len(addresses)
    assert len({file_name(key) for key in keys}) == len(addresses)


def test_a_socket_is_the_same_device_for_lines_and_for_visa() -> None:
    visa = address_key("visa", "TCPIP::127.0.0.1::5025::SOCKET")
    assert visa == address_key("serial", "socket://localhost:5025")


def test_the_units_behind_one_gateway_are_different_devices() -> None:
    rig = load_rig(shipped("rigs", "oil-circuit-modbus.yaml"))
    modbus = rig.backend.modbus
    assert modbus is not None
    other = modbus.model_copy(update={"unit": 2})
    second = rig.model_copy(update={"backend": rig.backend.model_copy(update={"modbus": other})})
    assert address_of(rig, "localhost:502").key == address_of(rig, "127.0.0.1:502").key
    assert address_of(rig, "localhost:502").key != address_of(second, "localhost:502").key
    assert address_of(rig, "/dev/ttyUSB7").key == address_of(second, "/dev/ttyUSB7").key, "the line itself"


@needs_posix("links to devices")
def test_a_link_to_a_serial_port_is_that_port(tmp_path: Path) -> None:
    port, link = tmp_path / "ttyACM0", tmp_path / "by-id"
    port.touch()
    link.symlink_to(port)
    assert address_key("serial", str(link)) == address_key("serial", str(port))
    assert address_key("modbus", str(link)) == address_key("visa", f"ASRL{port}::INSTR")
    assert address_key("serial", os.path.relpath(port)) == address_key("serial", str(port))


def test_a_name_is_its_numerical_address_and_an_unknown_one_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    def look_up(name: str, *_: object) -> list[tuple[object, ...]]:
        if name != "bench":
            raise OSError("unknown")
        return [(0, 0, 0, "", ("fe80::1%eth0", 0)), (0, 0, 0, "", ("10.0.0.9", 0))]

    monkeypatch.setattr(socket, "getaddrinfo", look_up)
    assert address_key("modbus", "bench:502") == address_key("modbus", "10.0.0.9:502")
    assert address_key("modbus", "Elsewhere.:502") == "tcp elsewhere 502"


@pytest.mark.parametrize(
    ("kind", "url"),
    [
        ("serial", "socket://bench:723456"),
        ("serial", "socket://[::1:7000"),
        ("serial", "rfc2217://bench:port"),
        ("opcua", "opc.tcp://bench:99999"),
        ("opcua", "opc.tcp://[::1"),
    ],
)
def test_what_is_no_address_is_its_own_key_and_refused_with_one_message(kind: str, url: str) -> None:
    """It used to end with a traceback, before the port that cannot be opened could be reported."""
    assert address_key(kind, url) == url
    if kind == "serial":
        with pytest.raises(RigctlError, match=re.escape(f"no address, got '{url}'; expected ")):
            open_port(url, {"baud": 9600, "frame": "8N1"}, ScaledClock())
