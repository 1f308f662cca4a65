"""Makes a bench on an OPC UA server from a rig file and command options."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rigctl.backends.lines.create import line_bench
from rigctl.backends.options import read_port, refuse_unknown, require_packages
from rigctl.backends.protocol import Backend
from rigctl.backends.transport.address import Address
from rigctl.clock import Clock
from rigctl.errors import RigctlError
from rigctl.rig import Rig
from rigctl.rig.protocols.opcua import Node, OpcUa, ReadNode

OPTIONS = ("port",)


def create(rig: Rig, clock: Clock, options: Mapping[str, object]) -> Backend:
    """Make a bench on an OPC UA server, not yet open.

    Parameters
    ----------
    rig: its ``backend.opcua`` names the nodes.
    clock: real.
    options: ``port`` (the server's ``opc.tcp://host:port/path``).

    Raises
    ------
    RigctlError
        as `address_of`.
    """
    return line_bench(rig, _nodes(rig).in_lines(rig.actuators), clock, address_of(rig, options))


def address_of(rig: Rig, options: Mapping[str, object]) -> Address:
    """Return the address of the server, with the settings of its client.

    Raises
    ------
    RigctlError
        an option is unknown or wrong, no server is named, or asyncua is missing.
    """
    refuse_unknown("option of the opcua backend", options, OPTIONS)
    expected = "e.g. '--port opc.tcp://192.168.0.22:4840'"
    port = read_port(rig, options, "where is the server?", expected, begins="opc.tcp://")
    require_packages("a server of OPC UA", "asyncua", "opcua", ["asyncua"])
    return Address("opcua", port, settings_of(_nodes(rig)))


def settings_of(server: OpcUa) -> dict[str, Any]:
    """Return the client's settings, which are JSON-compatible."""
    who, beat = server.identify, server.heartbeat
    return {
        "timeout": server.timeout,
        "wake": server.wake,
        "identify": None if who is None else [who.node, who.equals],
        "reads": [{name: _item(node) for name, node in nodes.items()} for _, nodes in server.reads],
        "writes": {name: _item(part) for name, part in server.actuators.items()},
        "heartbeat": None if beat is None else [beat.node, beat.every],
    }


def _item(node: Node) -> dict[str, Any]:
    read = node if isinstance(node, ReadNode) else None
    return {
        "node": node.node,
        "scale": node.scale,
        "offset": node.offset,
        "max_age": None if read is None else read.max_age,
        "age": read is not None and read.read == "age",
    }


def _nodes(rig: Rig) -> OpcUa:
    if rig.backend.opcua is None:
        raise RigctlError(f"the rig '{rig.name}' names no nodes", expected="'backend: {opcua: …}'")
    return rig.backend.opcua
