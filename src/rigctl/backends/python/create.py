"""Makes a bench on a driver class of a Python package from a rig file and command options."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rigctl.backends.lines.create import line_bench
from rigctl.backends.lines.setting import Setter
from rigctl.backends.options import refuse_unknown
from rigctl.backends.protocol import Backend
from rigctl.backends.python.permission import distribution, require_allowed
from rigctl.backends.transport.address import Address
from rigctl.clock import Clock
from rigctl.errors import RigctlError
from rigctl.rig import Rig
from rigctl.rig.protocols.python_driver import PythonDriver
from rigctl.rig.setting import POSITIONS
from rigctl.units import parse_unit

OPTIONS = ("port",)


def create(rig: Rig, clock: Clock, options: Mapping[str, object]) -> Backend:
    """Make a bench on a driver, not yet open.

    Parameters
    ----------
    rig: its ``backend.python`` describes the driver.
    clock: real.
    options: ``port``, which the driver is given.

    Raises
    ------
    RigctlError
        as `address_of`.
    """
    return line_bench(rig, _described(rig).in_lines(rig.actuators), clock, address_of(rig, options))


def address_of(rig: Rig, options: Mapping[str, object]) -> Address:
    """Return the address of the device, with the settings of the driver's process.

    Raises
    ------
    RigctlError
        an option is unknown, or the driver's package is not allowed or not installed.
    """
    refuse_unknown("option of the python backend", options, OPTIONS)
    described = _described(rig)
    require_allowed(described.package)
    port = options.get("port") or rig.backend.port
    text = None if port is None else str(port)
    return Address("python", text or described.driver, settings_of(rig, described, text))


def settings_of(rig: Rig, described: PythonDriver, port: str | None) -> dict[str, Any]:
    """Return the settings of the driver's process, which are JSON-compatible."""
    lines = described.in_lines(rig.actuators)
    leaving = [order.text.decode("utf-8").strip() for order in Setter(rig, lines).orders()]
    return {
        "driver": described.driver,
        "package": distribution(described.package),
        "port": port,
        "arguments": dict(described.arguments),
        "begin": [one.model_dump() for one in described.begin],
        "safe": [one.model_dump() for one in described.safe],
        "timeout": described.timeout,
        "tries": described.tries,
        "wake": described.wake,
        "identify": None if described.identify is None else described.identify.model_dump(),
        "reads": [{name: _read(rig, described, name) for name in group.names} for group in described.groups],
        "writes": {name: _written(rig, described, name) for name in described.actuators},
        "leaving": leaving,
    }


def _read(rig: Rig, described: PythonDriver, name: str) -> dict[str, Any]:
    """Return what is read for a channel, or the state of an actuator."""
    if name in described.channels:
        part, channel = described.channels[name], rig.channels[name]
        unit = part.unit or channel.raw_unit
        scale, offset = _conversion(part.unit, channel.raw_unit, difference=channel.difference)
        read = {"get": part.get, "item": part.item, "values": None, "within": 0.0}
    else:
        written = _written(rig, described, name)
        unit, scale, offset = written["unit"], written["scale"], written["offset"]
        read = {
            "get": described.actuators[name].confirm,
            "item": None,
            "values": written["values"],
            "within": described.actuators[name].within,
        }
    return {**read, "unit": unit, "scale": scale, "offset": offset}


def _written(rig: Rig, described: PythonDriver, name: str) -> dict[str, Any]:
    part, actuator = described.actuators[name], rig.actuators[name]
    positions = POSITIONS.get(actuator.kind)
    values = None
    if positions is not None:
        given = part.positions or {word: bool(number) for word, number in positions.items()}
        values = {f"{number:g}": given[word] for word, number in positions.items()}
    if part.scale is None:
        scale, offset = _conversion(part.unit, actuator.display_unit)
    else:
        unit = parse_unit(actuator.display_unit)
        low, high = (unit.from_si(float(end or 0.0)) for end in (actuator.low, actuator.high))
        first, last = part.scale
        scale = (high - low) / (last - first)
        offset = low - first * scale
    unit_of = part.unit or actuator.display_unit if part.scale is None else ""
    return {"set": part.set, "values": values, "unit": unit_of, "scale": scale, "offset": offset}


def _conversion(given: str | None, wanted: str, *, difference: bool = False) -> tuple[float, float]:
    """Return scale and offset of numbers from one unit to another."""
    if given is None or given == wanted:
        return 1.0, 0.0
    first, second = parse_unit(given), parse_unit(wanted)
    origin = second.from_si(first.to_si(0.0, difference=difference), difference=difference)
    return first.factor / second.factor, origin


def _described(rig: Rig) -> PythonDriver:
    if rig.backend.python is None:
        raise RigctlError(f"the rig '{rig.name}' names no driver", expected="'backend: {python: …}'")
    return rig.backend.python
