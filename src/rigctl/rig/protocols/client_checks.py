"""Checks across the fields of a register map, a server's nodes or a driver: names exist, numbers fit.

In: the section of a protocol, and the channels and actuators of the rig. Out: every `Problem` with its
place in the file, for `rigctl.rig.checks`. What all of these protocols have in common is checked by
`client_problems`; here is what each has of its own.

The ranges of registers are checked for every level and position of an actuator, the safe one included: a
number that does not fit into its register would be refused only when it is sent, which may be the command
that makes the bench safe.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from rigctl.errors import RigctlError
from rigctl.rig.actuator import Actuator
from rigctl.rig.channel import Channel
from rigctl.rig.problem import Problem
from rigctl.rig.protocols.client_lines import client_problems
from rigctl.rig.protocols.modbus import BITS, WRITABLE, Modbus, Register, WrittenRegister
from rigctl.rig.protocols.opcua import Node, OpcUa
from rigctl.rig.protocols.python_driver import PythonDriver
from rigctl.rig.setting import POSITIONS, Setting
from rigctl.units import describe, parse_unit

#: smallest and largest number of each integer type
_INTEGERS: Mapping[str, tuple[int, int]] = {
    "bool": (0, 1),
    **{f"int{bits}": (-(1 << bits - 1), (1 << bits - 1) - 1) for bits in (16, 32, 64)},
    **{f"uint{bits}": (0, (1 << bits) - 1) for bits in (16, 32, 64)},
}
_MODBUS = ("backend", "modbus")
_OPCUA = ("backend", "opcua")
_PYTHON = ("backend", "python")


def register_problems(
    modbus: Modbus,
    channels: Mapping[str, Channel],
    actuators: Mapping[str, Actuator],
    safe_state: Mapping[str, Setting],
) -> Iterator[Problem]:
    """Yield all inconsistencies between a register map and the rest of the rig file."""
    written = {name: part.values for name, part in modbus.actuators.items()}
    yield from client_problems(channels, actuators, _MODBUS, modbus.channels, written)
    for name, register in modbus.channels.items():
        yield from _register(register, (*_MODBUS, "channels", name))
    for name, part in modbus.actuators.items():
        keys = (*_MODBUS, "actuators", name)
        yield from _written(part, keys)
        if name in actuators and part.scale != 0.0:
            yield from _fits(name, actuators[name], part, safe_state.get(name))
        if isinstance(part.readback, Register):
            yield from _register(part.readback, (*keys, "readback"))
    if modbus.identify is not None:
        yield from _register(modbus.identify, (*_MODBUS, "identify"))
    if modbus.heartbeat is not None:
        yield from _written(modbus.heartbeat, (*_MODBUS, "heartbeat"))


def _written(register: Register, keys: tuple[str, ...]) -> Iterator[Problem]:
    yield from _register(register, keys)
    if register.table not in WRITABLE:
        error = RigctlError(
            "table: this one can only be read", value=register.table, expected=" or ".join(WRITABLE)
        )
        yield Problem((*keys, "table"), error)


def _fits(name: str, actuator: Actuator, part: WrittenRegister, safe: Setting | None) -> Iterator[Problem]:
    """Check that every value of an actuator is in the range of its register's type.

    A command out of range would fail during a run, even one that makes outputs safe.
    """
    ends = _INTEGERS.get(part.number_type)
    if ends is None:
        return
    numbers: list[tuple[tuple[str, ...], float, str]]
    positions = POSITIONS.get(actuator.kind)
    if positions is not None:
        place = (*_MODBUS, "actuators", name, "values")
        numbers = [(place, number, f"{number:g}") for number in (part.values or positions).values()]
    else:
        ends_of = (("low", actuator.low), ("high", actuator.high))
        levels = [
            *((("actuators", name, end), level) for end, level in ends_of),
            (("safe_state", name), safe),
        ]
        unit = parse_unit(actuator.display_unit)
        numbers = [
            (keys, unit.from_si(float(level)), level.text) for keys, level in levels if level is not None
        ]
    shown = actuator.display_unit if positions is None and actuator.display_unit != "1" else ""
    low, high = sorted(end * part.scale + part.offset for end in ends)
    for keys, number, text in numbers:
        if not ends[0] <= round((number - part.offset) / part.scale) <= ends[1]:
            error = RigctlError(
                f"{keys[-1]}: does not fit into the {part.number_type} of its register",
                value=text,
                expected=f"{low:g} to {high:g} {shown}".rstrip(),
            )
            yield Problem(keys, error)


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


def node_problems(
    server: OpcUa, channels: dict[str, Channel], actuators: dict[str, Actuator]
) -> Iterator[Problem]:
    """Yield all inconsistencies between the nodes and the rest of the rig file."""
    written = {name: part.values for name, part in server.actuators.items()}
    yield from client_problems(channels, actuators, _OPCUA, server.channels, written)
    for name, channel in server.channels.items():
        keys = (*_OPCUA, "channels", name)
        yield from _node(channel, keys)
        if channel.read == "age" and name in channels and channels[name].quantity != "time":
            error = RigctlError(
                "read: an age is a time", value=channels[name].quantity, expected="quantity: time"
            )
            yield Problem((*keys, "read"), error)
    for name, part in server.actuators.items():
        keys = (*_OPCUA, "actuators", name)
        yield from _node(part, keys)
        if isinstance(part.readback, Node):
            yield from _node(part.readback, (*keys, "readback"))


def _node(node: Node, keys: tuple[str, ...]) -> Iterator[Problem]:
    if node.scale == 0.0:
        yield Problem((*keys, "scale"), RigctlError("scale: all numbers would be the same", value="0"))


def driver_problems(
    driver: PythonDriver, channels: Mapping[str, Channel], actuators: Mapping[str, Actuator]
) -> Iterator[Problem]:
    """Yield all inconsistencies between what is called of a driver and the rest of the rig file."""
    # the values of positions may be anything: only their names are checked, with numbers in their place
    written = {
        name: None if part.positions is None else {word: float(at) for at, word in enumerate(part.positions)}
        for name, part in driver.actuators.items()
    }
    yield from client_problems(channels, actuators, _PYTHON, driver.channels, written)
    for name, read in driver.channels.items():
        if name in channels and read.unit is not None:
            keys = (*_PYTHON, "channels", name, "unit")
            yield from _unit(read.unit, channels[name].raw_unit, keys)
    for name, part in driver.actuators.items():
        if part.scale is not None and (part.scale[0] == part.scale[1] or part.unit is not None):
            error = RigctlError("scale: two different numbers, and no unit beside it")
            yield Problem((*_PYTHON, "actuators", name, "scale"), error)
        if name in actuators and part.unit is not None:
            yield from _unit(part.unit, actuators[name].display_unit, (*_PYTHON, "actuators", name, "unit"))


def _unit(written: str, wanted: str, keys: tuple[str, ...]) -> Iterator[Problem]:
    """Check that a number in one unit can be converted to another."""
    try:
        same = parse_unit(written).dimension == parse_unit(wanted).dimension
    except RigctlError as error:
        yield Problem(keys, error)
        return
    if not same:
        yield Problem(keys, RigctlError("unit: wrong dimension", value=written, expected=describe(wanted)))
