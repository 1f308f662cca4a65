"""The client of a Modbus device: translates `rigctl.rig.protocols.client_lines` to requests for registers.

pymodbus implements the protocol, in the thread of a `ClientPort`.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Mapping, Sequence
from typing import Any

from rigctl.backends.modbus.numbers import Place
from rigctl.backends.transport.address_key import modbus_tcp_address
from rigctl.backends.transport.client_port import ClientPort
from rigctl.backends.transport.port import AnotherDevice, PortLost
from rigctl.clock import Clock

#: function codes of the protocol
_READS = {"coil": 1, "discrete": 2, "holding": 3, "input": 4}
_WRITE_COIL, _WRITE_REGISTER, _WRITE_REGISTERS = 5, 6, 16
_EXCEPTIONS = {
    1: "illegal function",
    2: "illegal address",
    3: "illegal value",
    4: "device failure",
    5: "accepted, not done yet",
    6: "device busy",
    8: "memory parity error",
    10: "no path behind the gateway",
    11: "no answer behind the gateway",
}
_LONGEST_NOISE = 2.0  # s to wait for silence; a line with other traffic never falls silent


def open_port(url: str, settings: Mapping[str, Any], clock: Clock) -> ClientPort:
    """Open the port of an `Address`: ``host:port`` for TCP, anything else is a serial device.

    Its settings are those of `rigctl.backends.modbus.create.settings_of`.
    """
    return ClientPort(url, lambda: ModbusClient(url, settings), clock)


class ModbusClient:
    """One connection, with the registers of the rig file.

    Raises
    ------
    PortLost
        there is no connection.
    """

    def __init__(self, url: str, settings: Mapping[str, Any]) -> None:
        from pymodbus.exceptions import ModbusException

        logging.getLogger("pymodbus").addHandler(logging.NullHandler())  # relevant errors are raised
        self._name = url
        self._unit = settings["unit"]
        self._identity = settings["identity"]
        self._identify = None if settings["identify"] is None else Place(**settings["identify"][0])
        self._equals = None if settings["identify"] is None else float(settings["identify"][1])
        self._blocks = [
            (table, address, count, {name: Place(**place) for name, place in places.items()})
            for table, address, count, places in settings["blocks"]
        ]
        self._writes = {name: Place(**place) for name, place in settings["writes"].items()}
        self._heartbeat = None if settings["heartbeat"] is None else Place(**settings["heartbeat"][0])
        self._every = 0.0 if settings["heartbeat"] is None else float(settings["heartbeat"][1])
        self._identified = False
        self._count = 0
        self._beat_at = -math.inf  # s, monotonic
        self._set: dict[
            str, tuple[list[int], float, str]
        ] = {}  # last written: registers, their number, its text
        self._failed: type[Exception] = ModbusException
        self._library = _connection(url, settings)
        if not self._library.connect():
            serial = "it cannot be opened: not there, in use, no right to, or without such a frame"
            raise PortLost(f"{url}: {serial if modbus_tcp_address(url) is None else 'nobody is there'}")

    def answer(self, line: str) -> str | None:
        """Return the answer to a line of `rigctl.rig.protocols.client_lines`."""
        self._require_connection()
        name, _, argument = line.partition(" ")
        try:
            answer = self._carry_out(name, argument)
            if time.monotonic() - self._beat_at >= self._every:  # only while the caller is alive
                self._beat()
            return answer
        # An exception code is an answer: to the code above it is a line that says so, not a loss of contact.
        except (_RefusedError, ValueError) as refused:
            return f"error {refused}"
        except self._failed:  # no answer now; raises if the connection is lost, and there will never be one
            self._require_connection()
            self._await_silence()
            return None
        except OSError as error:
            raise PortLost(f"{self._name}: {error}") from None

    def close(self) -> None:
        """Close the connection."""
        self._library.close()

    def _require_connection(self) -> None:
        if not self._library.connected:
            raise PortLost(f"{self._name}: the connection was closed")

    def _carry_out(self, name: str, argument: str) -> str:
        if name == "identify":
            return self._who()
        if name == "read":
            return self._read(int(argument))
        if name == "write":
            return self._write(*argument.split(" "))
        if name == "beat":
            return "ok"
        raise ValueError(f"not understood: {name}")

    def _who(self) -> str:
        if self._identify is None:
            table, address, count, _ = self._blocks[0]
            self._fetch(table, address, count)  # only to check the connection
            return str(self._identity)
        found = self._identify.text(
            self._fetch(self._identify.table, self._identify.address, self._identify.width)
        )
        # Before the first success a wrong identity is only reported, as the address may be wrong; afterwards
        # it means that the device was exchanged, which ends the contact.
        if float(found) != self._equals:
            said = f"modbus unit {self._unit} is {float(found):.15g}"
            if self._identified:
                raise AnotherDevice(f"{self._name}: another device answers than before: {said}")
            return said
        self._identified = True
        return str(self._identity)

    def _read(self, index: int) -> str:
        table, address, count, places = self._blocks[index]
        words = self._fetch(table, address, count)
        texts = []
        for name, place in places.items():
            there = words[place.address - address : place.address - address + place.width]
            written = self._set.get(name)
            # A register rounds what is written. Where it has what was written, the text of the command is
            # repeated, so that the number read equals the one commanded; any other content is a state of the
            # device's own.
            same = written is not None and (written[0] == there or place.repeats(there, written[1]))
            texts.append(written[2] if written is not None and same else place.text(there))
        return " ".join(texts)

    def _write(self, name: str, text: str) -> str:
        place = self._writes[name]
        words = place.words(float(text))
        self._put(place, words)
        self._set[name] = (words, place.number(words), text)
        return "ok"

    def _beat(self) -> None:
        place, self._beat_at = self._heartbeat, time.monotonic()
        if place is not None:
            self._count = (self._count + 1) % (2 if place.is_bit else 1 << 15)
            self._put(place, place.words(self._count * place.scale + place.offset))

    def _fetch(self, table: str, address: int, count: int) -> list[int]:
        library = self._ready()
        reading = {
            "coil": library.read_coils,
            "discrete": library.read_discrete_inputs,
            "input": library.read_input_registers,
            "holding": library.read_holding_registers,
        }[table]
        answer = reading(address, count=count, device_id=self._unit)
        _require(answer, f"{table} {address}", _READS[table])
        found: Sequence[int] = answer.bits if table in ("coil", "discrete") else answer.registers
        spare = 8 if table in ("coil", "discrete") else 1  # bits are transmitted in whole bytes
        if not count <= len(found) < count + spare:
            raise _RefusedError(f"{len(found)} values instead of {count} from {table} {address}")
        return [int(word) for word in found[:count]]

    def _put(self, place: Place, words: list[int]) -> None:
        library = self._ready()
        if place.is_bit:
            done = _WRITE_COIL
            answer = library.write_coil(place.address, bool(words[0]), device_id=self._unit)
        elif len(words) == 1:
            done = _WRITE_REGISTER
            answer = library.write_register(place.address, words[0], device_id=self._unit)
        else:
            done = _WRITE_REGISTERS
            answer = library.write_registers(place.address, words, device_id=self._unit)
        where = f"{place.table} {place.address}"
        _require(answer, where, done)
        # RTU has no transaction numbers: a late confirmation of another write looks like the one to this.
        if answer.address != place.address:
            raise _RefusedError(f"a write to {answer.address} was confirmed instead of one to {where}")
        said = answer.bits[:1] if place.is_bit else answer.registers
        if done != _WRITE_REGISTERS and [int(word) for word in said] != [int(word) for word in words]:
            raise _RefusedError(f"{said} was confirmed instead of {words} at {where}")

    def _ready(self) -> Any:
        """Return the library's client after discarding late answers, since RTU has no transaction numbers."""
        if (line := self._serial_line) is not None:
            line.reset_input_buffer()
        return self._library

    def _await_silence(self) -> None:
        """On a serial line, wait until nothing has arrived for as long as an answer may take.

        A late answer would be taken for the answer to the next request, as it contains no register address.
        """
        if (line := self._serial_line) is None:
            return
        give_up = time.monotonic() + _LONGEST_NOISE
        while line.read(1) and time.monotonic() < give_up:
            line.reset_input_buffer()

    @property
    def _serial_line(self) -> Any:
        """The pyserial port of an RTU connection; None for TCP."""
        socket = self._library.socket
        return socket if hasattr(socket, "reset_input_buffer") else None


class _RefusedError(Exception):
    """The device answers with an exception code."""


def _require(answer: Any, where: str, function: int) -> None:
    if answer.isError():
        code = getattr(answer, "exception_code", 0)
        raise _RefusedError(f"{_EXCEPTIONS.get(code, 'exception')} ({code}) at {where}")
    if answer.function_code != function:  # the library accepts it as the answer to any request
        raise _RefusedError(f"an answer to function {answer.function_code}, not to {function}, at {where}")


def _connection(url: str, settings: Mapping[str, Any]) -> Any:
    from pymodbus.client import ModbusSerialClient, ModbusTcpClient

    known = {"timeout": settings["timeout"], "retries": 0}
    address = modbus_tcp_address(url)
    if address is not None:
        return ModbusTcpClient(address[0], port=address[1], **known)
    bits, parity, stops = settings["frame"]
    return ModbusSerialClient(
        url, baudrate=settings["baud"], bytesize=int(bits), parity=parity, stopbits=int(stops), **known
    )
