"""An OPC UA server: the node read for each channel, and the node written for each actuator."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Annotated, Literal

from pydantic import Field, FiniteFloat

from rigctl.files.name import Name
from rigctl.files.quantity import Q
from rigctl.rig.actuator import Actuator
from rigctl.rig.base import RigFilePart
from rigctl.rig.protocols.client_lines import Every, Positions, Tries, client_lines
from rigctl.rig.protocols.lines import Lines, Watchdog

_Seconds = Annotated[float, Q("s", positive=True)]

#: a node by its identifier: a number, a text, a GUID or bytes in base64
NODE = r"^(ns=\d{1,5};)?(i=\d{1,10}|s=.{1,1024}|g=[0-9A-Fa-f-]{36}|b=[A-Za-z0-9+/=]{1,1024})$"


class Node(RigFilePart):
    """A variable of the server, and the meaning of its number."""

    node: str = Field(pattern=NODE, description="its node id, e.g. ns=2;s=Circuit.SupplyPressure")
    scale: FiniteFloat = Field(default=1.0, description="the number in its unit is node * scale + offset")
    offset: FiniteFloat = Field(default=0.0, description="see scale")


class ReadNode(Node):
    """A variable read for a channel."""

    every: Every = None
    max_age: _Seconds | None = Field(
        default=None,
        description="a value whose source timestamp is further from the server's present time is missing",
    )
    read: Literal["value", "age"] = Field(
        default="value", description="its value, or the age of its source timestamp in s"
    )


class IdentityNode(RigFilePart):
    """A variable that identifies the server."""

    node: str = Field(pattern=NODE, description="its node id")
    equals: str = Field(
        min_length=1, description="the expected value, as text; any other means a different plant"
    )


class HeartbeatNode(RigFilePart):
    """An integer that rigctl increments while running, for a controller that switches off when it stops."""

    node: str = Field(pattern=NODE, description="its node id")
    every: _Seconds = Field(default=0.5, description="interval between two counts")


class WrittenNode(Node):
    """A variable written for an actuator."""

    values: Positions = None
    readback: Node | bool = Field(
        default=True,
        description="where its state is read with each sample: true: where it is written; false: not read",
    )


class OpcUa(RigFilePart):
    """An OPC UA server, without encryption and as an anonymous user."""

    timeout: Annotated[float, Q("s", low="0.1 s", high="10 s")] = Field(
        default=1.0, description="how long an answer may take"
    )
    tries: Tries = 2
    wake: _Seconds = Field(default=5.0, description="how long connecting may take")
    fastest: Annotated[float, Q("Hz", positive=True)] = Field(
        default=10.0,
        description="the highest sampling rate; servers update their values every 50 to 100 ms",
    )
    identify: IdentityNode | None = Field(default=None, description="read first")
    channels: dict[Name, ReadNode] = Field(description="where each channel is read")
    actuators: dict[Name, WrittenNode] = Field(
        default_factory=dict, description="where each driven actuator is written"
    )
    heartbeat: HeartbeatNode | None = Field(default=None, description="written again and again")
    watchdog: Watchdog = 3.0

    @cached_property
    def reads(self) -> tuple[tuple[float | None, Mapping[str, Node]], ...]:
        """The nodes, grouped by their interval; each group is read in one request."""
        found: dict[float | None, dict[str, Node]] = {}
        for name, channel in self.channels.items():
            found.setdefault(channel.every, {})[name] = channel
        for name, part in self.actuators.items():
            state = part if part.readback is True else part.readback
            if isinstance(state, Node):
                found.setdefault(None, {})[name] = state
        return tuple(found.items())

    def in_lines(self, actuators: Mapping[str, Actuator]) -> Lines:
        """Return the line protocol of its client, `rigctl.backends.opcua.client`."""
        return client_lines(
            self,
            actuators,
            identity="opcua {product}",
            reads=[(tuple(nodes), every) for every, nodes in self.reads],
        )
