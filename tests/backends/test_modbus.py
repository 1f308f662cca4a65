"""Modbus: numbers in registers, block reads, mistakes in the map, RTU on a serial line, `rigctl doctor`."""

from __future__ import annotations

import json
import math
import re
import socket
import struct
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from commands import call
from late_serial import LateSerialDevice
from patience import patient, unhurried
from protocol_servers import ModbusServer, RtuServer
from rigctl.backends.modbus.client import ModbusClient
from rigctl.backends.modbus.create import settings_of
from rigctl.backends.modbus.numbers import Place
from rigctl.backends.registry import create_backend
from rigctl.backends.transport.safe_state_retries import retrying_guards
from rigctl.clock import real_clock
from rigctl.errors import RigctlError
from rigctl.files.shipped import shipped
from rigctl.rig import load_rig, parse_rig
from rigctl.rig.protocols.modbus import Modbus
from systems import needs_posix

RIG = load_rig(shipped("rigs", "oil-circuit-modbus.yaml"))
PATIENT = parse_rig(patient(RIG.text))

FORMATS = {
    "int16": "h", "uint16": "H", "int32": "i", "uint32": "I",
    "int64": "q", "uint64": "Q", "float32": "f", "float64": "d",
}  # fmt: skip


def modbus(**fields: Any) -> Modbus:
    return Modbus.model_validate({"channels": {"x": {"table": "input", "address": 0}}, **fields})


def place(**fields: Any) -> Place:
    plain = {"table": "holding", "address": 0, "kind": "uint16", "swap_bytes": False, "swap_words": False}
    return Place(**{**plain, "scale": 1.0, "offset": 0.0, "invalid": None, **fields})


@given(
    kind=st.sampled_from(sorted(FORMATS)),
    swap_bytes=st.booleans(),
    swap_words=st.booleans(),
    data=st.data(),
)
def test_packed_numbers_are_read(kind: str, swap_bytes: bool, swap_words: bool, data: st.DataObject) -> None:
    """The registers are packed independently of the reading code, according to the standard."""
    if kind.startswith("float"):
        width = int(kind[5:])
        number: float = data.draw(
            st.floats(width=width, allow_nan=False, allow_infinity=False, allow_subnormal=False)  # type: ignore[arg-type]
        )
    else:
        bits, signed = int(kind.removeprefix("u")[3:]), not kind.startswith("u")
        low = -(1 << bits - 1) if signed else 0
        number = data.draw(st.integers(low, low + (1 << bits) - 1))
    packed = struct.pack(">" + FORMATS[kind], number)
    registers = [packed[at : at + 2] for at in range(0, len(packed), 2)]
    if swap_bytes:
        registers = [register[::-1] for register in registers]
    if swap_words:
        registers.reverse()
    words = [int.from_bytes(register, "big") for register in registers]
    there = place(kind=kind, swap_bytes=swap_bytes, swap_words=swap_words)
    assert float(there.text(words)) == pytest.approx(number, rel=1e-7)
    if abs(number) < 2**53:
        assert there.words(number) == words


def test_scale_and_offset_apply_in_both_directions() -> None:
    there = place(kind="int16", scale=0.1, offset=-40.0)
    assert float(there.text([650])) == 25.0
    assert there.words(25.0) == [650]
    assert float(place(kind="int16", scale=0.1).text([0xFFFF])) == -0.1


def test_missing_values_are_nan() -> None:
    assert place(kind="int16", invalid=-32768).text([0x8000]) == "nan"
    assert place(kind="float32").text([0x7FC0, 0]) == "nan"
    assert place(kind="float32", swap_words=True).text([0x41F0, 0x0000]) == "nan"  # 30 the other way round
    assert float(place(kind="float32").text([0, 0])) == 0.0


def test_values_out_of_range_are_not_written() -> None:
    for number in (65536.0, -1.0, math.inf):
        with pytest.raises(ValueError, match=r"does not fit|can be written"):
            place(kind="uint16").words(number)


def test_adjacent_registers_are_read_in_one_request_and_long_tables_in_several() -> None:
    channels = {
        f"c{index}": {"table": "input", "address": 2 * index, "type": "float32"} for index in range(100)
    }
    blocks = modbus(channels=channels).blocks
    assert [(block.address, block.count) for block in blocks] == [(0, 124), (124, 76)]
    gaps = {"a": {"table": "input", "address": 0}, "b": {"table": "input", "address": 4}}
    assert [block.count for block in modbus(channels=gaps).blocks] == [1, 1]
    assert [block.count for block in modbus(channels=gaps, read_gaps=3).blocks] == [5]
    slow = {"a": {"table": "input", "address": 0}, "b": {"table": "input", "address": 1, "every": "1 s"}}
    assert [block.every for block in modbus(channels=slow).blocks] == [None, 1.0]


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("supply_pressure: {table: input", "suply_pressure: {table: input", "did you mean 'supply_pressure'"),
        ("heater: {table: coil", "heater: {table: discrete", "can only be read, got 'discrete'"),
        ("type: uint16, scale: 0.01}", "type: bool, scale: 0.01}", "none of a holding"),
        ("type: uint16, scale: 0.01}", "type: uint16, scale: 0}", "all numbers would be the same"),
        ("address: 0, type: float32", "address: 65535, type: float32", "behind the last register"),
        ("      relief_valve: {table: holding", "      # {table: holding", "where 'relief_valve' is written"),
        ("heater: {table: coil, address: 0}", "heater: {table: coil, address: 0, values: {on: 1}}", "none"),
        ("kind: modbus", "kind: modbuss", "did you mean 'modbus'"),
        ("timeout: 0.3 s", "timeout: 0.3 bar", "timeout"),
    ],
)  # fmt: skip
def test_a_mistake_in_the_map_is_reported_with_its_place(old: str, new: str, says: str) -> None:
    assert old in RIG.text
    with pytest.raises(RigctlError, match=says) as refused:
        parse_rig(RIG.text.replace(old, new, 1), Path("rig.yaml"))
    assert "rig.yaml:" in str(refused.value)


def doctor(rig: Path, port: str) -> dict[str, Any]:
    done = call("doctor", "--rig", str(rig), "--port", port, "--json")
    answer: dict[str, Any] = json.loads(done.stdout)
    asked = {finding["subject"]: finding for finding in answer["findings"]}
    return {"code": done.exit_code, **answer["asked"][0], "findings": asked}


def test_the_doctor_reads_every_channel_and_names_the_right_word_order(tmp_path: Path) -> None:
    rig = tmp_path / "rig.yaml"
    rig.write_text(PATIENT.text, encoding="utf-8")
    with ModbusServer(RIG) as server:
        server.circuit.set("relief_valve", 30e5)
        while server.circuit.read()["supply_pressure"] < 29.99e5:
            time.sleep(0.01)
        well = doctor(rig, server.port)
        assert well["values"]["supply_pressure"] == pytest.approx(30e5, rel=1e-3)
        assert well["findings"]["supply_pressure"]["state"] == "ok"
        assert server.circuit.outputs["relief_valve"] == 30e5, "nothing is set"
        server.little = True
        wrong = doctor(rig, server.port)
        assert wrong["code"] == 1
        assert "with 'word_order: little'" in wrong["findings"]["supply_pressure"]["fix"]
        read = re.search(r"supply_pressure ([\d.]+) bar", wrong["findings"]["supply_pressure"]["fix"])
        assert read is not None
        assert float(read[1]) == pytest.approx(30.0, rel=1e-3)  # it is still settling
        other = rig.with_name("other.yaml")
        other.write_text(rig.read_text("utf-8").replace("equals: 4711", "equals: 4712"), encoding="utf-8")
        assert "another device" in doctor(other, server.port)["error"]
    assert "nobody is there" in doctor(rig, server.port)["error"]


@needs_posix("a pseudo-terminal")
def test_a_controller_is_read_and_switched_by_rtu_on_a_serial_line() -> None:
    with unhurried(), RtuServer(RIG) as server:
        rig = parse_rig(
            PATIENT.text.replace("unit: 1 ", "unit: 1\n    frame: 8N1 ")
        )  # a pty does not support parity
        bench = create_backend(rig, None, real_clock(), {"port": server.port})
        bench.open()
        try:
            bench.start(10.0)
            bench.command("relief_valve", 12e5).wait()
            assert server.circuit.outputs["relief_valve"] == 12e5
            server.mute = True
            while not any(notice.kind == "fault" for notice in bench.take_notices()):
                bench.next_sample(0.2)
            server.mute = False
            while not (sample := bench.next_sample(1.0)):
                pass
            assert sample.commands == (0.0, 0.0)
        finally:
            bench.close()
        assert server.circuit.off


def crc(frame: bytes) -> bytes:
    """The checksum of RTU: CRC-16 with the polynomial 0xA001, reflected."""
    found = 0xFFFF
    for byte in frame:
        found ^= byte
        for _ in range(8):
            found = found >> 1 ^ 0xA001 if found & 1 else found >> 1
    return found.to_bytes(2, "little")


def request_of_two(address: int) -> bytes:
    """The request for two holding registers of unit 1."""
    frame = struct.pack(">BBHH", 1, 3, address, 2)
    return frame + crc(frame)


def answer_with_addresses(request: bytes) -> bytes:
    """Each register contains its address."""
    address = int.from_bytes(request[2:4])
    frame = struct.pack(">BBBHH", 1, 3, 4, address, address + 1)
    return frame + crc(frame)


@needs_posix("a pseudo-terminal")
@pytest.mark.parametrize("waiting", [True, False])
def test_a_late_answer_by_rtu_is_not_taken_as_that_of_other_registers(waiting: bool) -> None:
    """It contains no address, and arrives while the client still waits for it, or afterwards."""
    device = LateSerialDevice(lambda sent: len(sent) == 8, answer_with_addresses, late=request_of_two(100))
    blocks = {"a": 100, "b": 101, "c": 200, "d": 201}
    channels = {name: {"table": "holding", "address": address} for name, address in blocks.items()}
    settings = settings_of(Modbus.model_validate({"channels": channels, "frame": "8N1"}), 19200)
    client = ModbusClient(device.port, {**settings, "timeout": 0.2})
    line: Any = client._library.socket
    read = line.read

    def answered_late(size: int) -> bytes:
        if size == 1:  # the request has ended without an answer
            device.answer_now()
        return bytes(read(size))

    if waiting:
        line.read = answered_late
    assert client.answer("read 0") is None
    assert device.has_answered == waiting
    device.answer_now()
    client._library.comm_params.timeout_connect = 60.0  # more than a busy computer takes to answer
    answers = [client.answer(f"read {block}") or "" for block in (1, 0, 1)]
    read_back = [[float(number) for number in answer.split()] for answer in answers]
    assert read_back == [[200.0, 201.0], [100.0, 101.0], [200.0, 201.0]]
    client.close()
    device.stop()


def test_the_heartbeat_continues_during_sampling() -> None:
    with unhurried(), ModbusServer(RIG) as server:
        bench = create_backend(PATIENT, None, real_clock(), {"port": server.port})
        bench.open()
        try:
            bench.start(20.0)
            while server.beats < 3:
                bench.next_sample(1.0)
        finally:
            bench.close()


def test_a_guard_continues_until_a_returning_device_is_off(tmp_path: Path) -> None:
    from backends.contract.test_devices import HOST

    (tmp_path / "rig.yaml").write_text(PATIENT.text, encoding="utf-8")
    with ModbusServer(RIG) as server:
        command = [sys.executable, "-c", HOST, str(tmp_path / "rig.yaml"), "modbus", server.port]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as host:
            assert host.stdout is not None
            assert host.stdout.readline() == "on\n"
            server.stop()
            host.kill()
        while not any(notice.port == server.port for notice in retrying_guards()):
            time.sleep(0.01)
        assert server.circuit.outputs["heater"] == 1.0
        server.start()
        while any(notice.port == server.port for notice in retrying_guards()):
            time.sleep(0.01)
        assert server.circuit.off


@pytest.mark.parametrize("broken", ["function", "address"])
def test_a_response_with_another_function_or_address_confirms_no_output(broken: str) -> None:
    """A gateway that confuses its clients: the transaction number is right, the answer is not."""

    def answer(listening: socket.socket) -> None:
        line, _ = listening.accept()
        with line:
            head = line.recv(7, socket.MSG_WAITALL)
            asked = line.recv(struct.unpack(">HHHB", head)[2] - 1, socket.MSG_WAITALL)
            found = bytearray(asked)
            if broken == "function":
                found[0] = 6 if asked[0] == 5 else 5
                found[3:5] = b"\xff\x00" if found[0] == 5 else found[3:5]
            else:
                found[2] ^= 1
            line.sendall(head + bytes(found))

    assert PATIENT.backend.modbus is not None
    with socket.create_server(("127.0.0.1", 0)) as listening:
        thread = threading.Thread(target=answer, args=(listening,))
        thread.start()
        settings = settings_of(PATIENT.backend.modbus, 19200)
        client = ModbusClient(f"127.0.0.1:{listening.getsockname()[1]}", settings)
        said = client.answer(f"write {next(iter(settings['writes']))} 0")
        client.close()
        thread.join()
    assert said is not None and said.startswith("error")
