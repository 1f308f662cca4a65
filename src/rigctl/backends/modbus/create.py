"""Makes a Modbus bench from a rig file and command options."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict
from typing import Any

from rigctl.backends.lines.create import line_bench
from rigctl.backends.modbus.numbers import Place
from rigctl.backends.options import read_port, refuse_unknown, require_packages
from rigctl.backends.protocol import Backend
from rigctl.backends.transport.address import Address
from rigctl.clock import Clock
from rigctl.errors import RigctlError
from rigctl.rig import Rig
from rigctl.rig.protocols.modbus import Modbus, Order, Register
from rigctl.rig.rates import BAUDS

OPTIONS = ("port", "baud")


def create(rig: Rig, clock: Clock, options: Mapping[str, object]) -> Backend:
    """Make a Modbus bench, not yet open.

    Parameters
    ----------
    rig: its ``backend.modbus`` gives the register of each number.
    clock: real.
    options: ``port`` (``host:port``, or a serial device for RTU), ``baud`` (of RTU).

    Raises
    ------
    RigctlError
        as `address_of`.
    """
    return line_bench(rig, _registers(rig).in_lines(rig.actuators), clock, address_of(rig, options))


def address_of(rig: Rig, options: Mapping[str, object]) -> Address:
    """Return the address of the device, with the settings of its client.

    Raises
    ------
    RigctlError
        an option is unknown or wrong, no port is named, or pymodbus is missing.
    """
    refuse_unknown("option of the modbus backend", options, OPTIONS)
    expected = "e.g. '--port 192.168.0.20:502', or '--port /dev/ttyUSB0' for RTU"
    port = read_port(rig, options, "where is the device?", expected)
    baud = options.get("baud") or rig.backend.baud or BAUDS["modbus"]
    if not isinstance(baud, int) or isinstance(baud, bool):
        raise RigctlError("not a baud rate", value=str(baud), expected="e.g. 19200")
    require_packages("a device on Modbus", "pymodbus", "modbus", ["pymodbus"])
    return Address("modbus", port, settings_of(_registers(rig), baud))


def other_orders(rig: Rig) -> Iterator[tuple[str, Rig]]:
    """Yield the rig with each other byte and word order, after the corresponding entries of the rig file."""
    modbus = _registers(rig)
    turned: dict[Order, Order] = {"big": "little", "little": "big"}
    word, byte = turned[modbus.word_order], turned[modbus.byte_order]
    for text, update in (
        (f"word_order: {word}", {"word_order": word}),
        (f"byte_order: {byte}", {"byte_order": byte}),
        (f"word_order: {word} and byte_order: {byte}", {"word_order": word, "byte_order": byte}),
    ):
        other = modbus.model_copy(update=update)
        yield text, rig.model_copy(update={"backend": rig.backend.model_copy(update={"modbus": other})})


def _registers(rig: Rig) -> Modbus:
    if rig.backend.modbus is None:
        raise RigctlError(f"the rig '{rig.name}' describes no registers", expected="'backend: {modbus: …}'")
    return rig.backend.modbus


def settings_of(modbus: Modbus, baud: int) -> dict[str, Any]:
    """Return the client's settings, which are JSON-compatible."""

    def place(register: Register) -> dict[str, Any]:
        return asdict(
            Place(
                table=register.table,
                address=register.address,
                kind=register.number_type,
                swap_bytes=(register.byte_order or modbus.byte_order) == "little",
                swap_words=(register.word_order or modbus.word_order) == "little",
                scale=register.scale,
                offset=register.offset,
                invalid=register.invalid,
            )
        )

    who = modbus.identify
    return {
        "unit": modbus.unit,
        "baud": baud,
        "frame": modbus.frame,
        "timeout": modbus.timeout,
        "identity": modbus.identity(),
        "identify": None if who is None else [place(who), who.equals],
        "blocks": [
            [
                block.table,
                block.address,
                block.count,
                {name: place(register) for name, register in block.registers.items()},
            ]
            for block in modbus.blocks
        ],
        "writes": {name: place(part) for name, part in modbus.actuators.items()},
        "heartbeat": None if modbus.heartbeat is None else [place(modbus.heartbeat), modbus.heartbeat.every],
    }
