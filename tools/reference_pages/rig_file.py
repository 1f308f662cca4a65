"""The page `docs/reference/rig-file.md`, generated from the models that read a rig file."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from rigctl.files.quantity import Q
from rigctl.files.schema import json_schema
from rigctl.rig.actuator import Actuator
from rigctl.rig.calibration import Calibration, Raw
from rigctl.rig.channel import Channel
from rigctl.rig.align import Align
from rigctl.rig.clock import Clock
from rigctl.rig.limit import Limit
from rigctl.rig.possible_sensors import PossibleChannel
from rigctl.rig.protocols.lines import Exchange, KeepAlive, LineActuator, Lines, Query
from rigctl.rig.protocols.modbus import Heartbeat, IdentityRegister, Modbus, ReadRegister, WrittenRegister
from rigctl.rig.protocols.opcua import HeartbeatNode, IdentityNode, OpcUa, ReadNode, WrittenNode
from rigctl.rig.protocols.python_driver import DriverCall, DriverIdentity, DriverRead, DriverSet, PythonDriver
from rigctl.rig.rig import Backend, Device, Rig
from rigctl.rig.roles import HeatRole, MoveRole, Roles, SetRole
from rigctl.rig.simulation import Simulation

_HEAD = """\
# The rig file

*Generated* from `src/rigctl/rig/` by `make docs`.

Every quantity is written with its unit; names are those that [expressions](expressions.md) can use.
`rigctl schema rig` prints the same as JSON Schema, from which editors complete and check a file.
[How to describe a bench](../how-to/describe-a-bench.md) explains a file from top to bottom.
"""

_LINES = """\
A device that answers text commands needs no driver code: this section defines the commands and the answers.
[How to connect a device by its lines](../how-to/connect-a-device-by-its-lines.md) builds one.

In a command `{value}` is replaced by the value of an actuator, `{value:.2f}` with two decimals, `{value:d}`
as an integer. In an answer `{name}` marks the number of the channel `name`, or the setting of the actuator of
that name; `{_}` is ignored. A literal brace is doubled: `{{`. The text between these fields must match
exactly; blanks at both ends of a line are ignored.
"""

_MODBUS = """\
A device on Modbus TCP, or RTU on a serial line, with its register map.
[How to connect a Modbus device](../how-to/connect-a-modbus-device.md) explains it.
"""

_OPCUA = """\
An OPC UA server, without encryption and as an anonymous user, with its nodes.
[How to connect an OPC UA server](../how-to/connect-an-opc-ua-server.md) explains it.
"""

_PYTHON = """\
A driver class of an installed package, in a process of its own; only packages that the user has allowed
are imported.
[How to use a Python driver](../how-to/use-a-python-driver.md) explains it.
"""

_DEVICES = """\
One of several devices of a bench, in place of `backend`, with the same fields: `lines`, `modbus`,
`opcua` and `python` are those below `backend`.
[How to use several devices](../how-to/use-several-devices.md) explains it.
"""

#: heading, location in the file, model, and the text before its table
_PARTS: tuple[tuple[str, type[BaseModel], str], ...] = (
    ("backend", Backend, ""),
    ("devices.NAME", Device, _DEVICES),
    ("backend.lines", Lines, _LINES),
    ("An exchange: identify, confirm, and each of begin and safe", Exchange, ""),
    ("Each of queries", Query, ""),
    ("backend.lines.actuators.NAME", LineActuator, ""),
    ("keep_alive", KeepAlive, ""),
    ("backend.modbus", Modbus, _MODBUS),
    ("backend.modbus.channels.NAME", ReadRegister, ""),
    ("backend.modbus.actuators.NAME", WrittenRegister, ""),
    ("backend.modbus.identify", IdentityRegister, ""),
    ("backend.modbus.heartbeat", Heartbeat, ""),
    ("backend.opcua", OpcUa, _OPCUA),
    ("backend.opcua.channels.NAME", ReadNode, ""),
    ("backend.opcua.actuators.NAME", WrittenNode, ""),
    ("backend.opcua.identify", IdentityNode, ""),
    ("backend.opcua.heartbeat", HeartbeatNode, ""),
    ("backend.python", PythonDriver, _PYTHON),
    ("backend.python.channels.NAME", DriverRead, ""),
    ("backend.python.actuators.NAME", DriverSet, ""),
    ("backend.python.identify", DriverIdentity, ""),
    ("backend.python, each of begin and safe", DriverCall, ""),
    ("channels.NAME", Channel, ""),
    ("channels.NAME.raw", Raw, ""),
    ("channels.NAME.calibration", Calibration, ""),
    ("clocks.NAME", Clock, ""),
    ("align", Align, ""),
    ("could_have.NAME", PossibleChannel, ""),
    ("actuators.NAME", Actuator, ""),
    ("roles", Roles, ""),
    ("roles.heat", HeatRole, ""),
    ("roles.set_pressure", SetRole, ""),
    ("roles.extend, roles.retract", MoveRole, ""),
    ("limits.NAME", Limit, ""),
    ("simulation", Simulation, ""),
)


def rig_page() -> str:
    """Return the page: the top-level fields, then those of every part."""
    schema = json_schema(Rig, title="")
    lines = [_HEAD, "## The file", "", *_table(Rig, schema["properties"])]
    for heading, model, before in _PARTS:
        about = before.rstrip() or " ".join((model.__doc__ or "").split())
        lines += [
            "",
            f"## {heading}",
            "",
            about,
            "",
            *_table(model, schema["$defs"][model.__name__]["properties"]),
        ]
    return "\n".join(lines).rstrip() + "\n"


def _table(model: type[BaseModel], properties: dict[str, Any]) -> Iterator[str]:
    yield "| field | for example | default | meaning |"
    yield "|---|---|---|---|"
    for name, info in model.model_fields.items():
        key = info.alias or name
        examples = ", ".join(f"`{example}`" for example in _examples(properties[key])[:4])
        yield f"| `{key}` | {examples} | {_default(info)} | {info.description or ''} |"


def _examples(schema: Any) -> list[str]:
    """Return the examples given by a schema or one of its branches, or else the values that it allows."""
    if not isinstance(schema, dict):
        return []
    found = schema.get("enum") or schema.get("examples") or []
    for branch in (*schema.get("anyOf", ()), schema.get("items")):
        found = found or _examples(branch)
    return [str(example) for example in found]


def _default(info: FieldInfo) -> str:
    if info.is_required():
        return "required"
    default = info.get_default(call_default_factory=True, validated_data={})
    if default is None or default in ("", (), {}) or isinstance(default, BaseModel):
        return ""
    quantity = next((entry for entry in info.metadata if isinstance(entry, Q)), None)
    if quantity is not None and quantity.unit != "1":
        return f"`{default:g} {quantity.unit}`"
    if isinstance(default, bool):
        return f"`{str(default).lower()}`"
    if isinstance(default, tuple):
        return f"`{list(default)}`"
    return f"`{default!r}`" if isinstance(default, str) and not default.isalnum() else f"`{default}`"
