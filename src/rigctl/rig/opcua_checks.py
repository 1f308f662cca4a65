"""Checks across the fields of an OPC UA server's nodes: names exist, and an age is read as a time."""

from __future__ import annotations

from collections.abc import Iterator

from rigctl.errors import RigctlError
from rigctl.rig.actuator import Actuator
from rigctl.rig.channel import Channel
from rigctl.rig.client_lines import client_problems
from rigctl.rig.opcua import Node, OpcUa
from rigctl.rig.problem import Problem

_AT = ("backend", "opcua")


def node_problems(
    server: OpcUa, channels: dict[str, Channel], actuators: dict[str, Actuator]
) -> Iterator[Problem]:
    """Yield all inconsistencies between the nodes and the rest of the rig file."""
    written = {name: part.values for name, part in server.actuators.items()}
    yield from client_problems(channels, actuators, _AT, server.channels, written)
    for name, channel in server.channels.items():
        keys = (*_AT, "channels", name)
        yield from _node(channel, keys)
        if channel.read == "age" and name in channels and channels[name].quantity != "time":
            error = RigctlError(
                "read: an age is a time", value=channels[name].quantity, expected="quantity: time"
            )
            yield Problem((*keys, "read"), error)
    for name, part in server.actuators.items():
        keys = (*_AT, "actuators", name)
        yield from _node(part, keys)
        if isinstance(part.readback, Node):
            yield from _node(part.readback, (*keys, "readback"))


def _node(node: Node, keys: tuple[str, ...]) -> Iterator[Problem]:
    if node.scale == 0.0:
        yield Problem((*keys, "scale"), RigctlError("scale: all numbers would be the same", value="0"))
