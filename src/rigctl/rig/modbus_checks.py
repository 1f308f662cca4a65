"""What no single field of a register map can know: names lead somewhere, what is written can be."""

from __future__ import annotations

from collections.abc import Iterator

from rigctl.errors import RigctlError
from rigctl.rig.actuator import Actuator
from rigctl.rig.channel import Channel
from rigctl.rig.client_lines import client_problems
from rigctl.rig.modbus import BITS, WRITABLE, Modbus, Register
from rigctl.rig.problem import Problem

_AT = ("backend", "modbus")


def register_problems(
    modbus: Modbus, channels: dict[str, Channel], actuators: dict[str, Actuator]
) -> Iterator[Problem]:
    """Everything wrong with a register map that the rest of the rig file shows."""
    written = {name: part.values for name, part in modbus.actuators.items()}
    yield from client_problems(channels, actuators, _AT, modbus.channels, written)
    for name, register in modbus.channels.items():
        yield from _register(register, (*_AT, "channels", name))
    for name, part in modbus.actuators.items():
        keys = (*_AT, "actuators", name)
        yield from _written(part, keys)
        if isinstance(part.readback, Register):
            yield from _register(part.readback, (*keys, "readback"))
    if modbus.identify is not None:
        yield from _register(modbus.identify, (*_AT, "identify"))
    if modbus.heartbeat is not None:
        yield from _written(modbus.heartbeat, (*_AT, "heartbeat"))


def _written(register: Register, keys: tuple[str, ...]) -> Iterator[Problem]:
    yield from _register(register, keys)
    if register.table not in WRITABLE:
        error = RigctlError(
            "table: this one can only be read", value=register.table, expected=" or ".join(WRITABLE)
        )
        yield Problem((*keys, "table"), error)


def _register(register: Register, keys: tuple[str, ...]) -> Iterator[Problem]:
    bit, kind = register.table in BITS, register.number_type
    if bit != (kind == "bool"):
        expected = "bool" if bit else "one of a register, e.g. uint16"
        yield Problem(
            (*keys, "type"), RigctlError(f"type: none of a {register.table}", value=kind, expected=expected)
        )
    if register.scale == 0.0:
        yield Problem((*keys, "scale"), RigctlError("scale: all numbers would be the same", value="0"))
    if register.end > 1 << 16:
        yield Problem((*keys, "address"), RigctlError("address: the number ends behind the last register"))
