"""Reads a device's identity and one value of every channel, without setting anything."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from statistics import median

from rigctl.backends.lines.handshake import handshake
from rigctl.backends.lines.line_client import LineClient, WrongAnswer
from rigctl.backends.lines.line_codec import LineCodec
from rigctl.backends.transport.address import Address
from rigctl.backends.transport.conversation import carry_through
from rigctl.clock import Clock
from rigctl.rig import Lines, Rig


@dataclass
class OneReading:
    """The identity of a device, and one value of every channel.

    Attributes
    ----------
    identity: the device's identity, as far as known.
    values: SI, by channel; NaN for missing values.
    troubles: answers that were not values.
    round_trip: median round-trip time of the queries, s.
    """

    identity: Mapping[str, str]
    values: dict[str, float] = field(default_factory=dict)
    troubles: list[str] = field(default_factory=list)
    round_trip: float = math.nan

    def impossible(self, rig: Rig) -> list[str]:
        """Return the channels whose values are physically impossible."""
        return [name for name, value in self.values.items() if not rig.channels[name].possible(value)]


def read_once(rig: Rig, lines: Lines, address: Address, clock: Clock) -> OneReading:
    """Connect to a device, identify it, and read every channel once.

    Raises
    ------
    PortLost
        there is no answer.
    RigctlError
        another device answers, or there is no permission to open the port.
    """
    port = address.open(clock)
    try:
        client, meaning, trips = LineClient(port, clock, lines), LineCodec(rig, lines), []
        reading = OneReading(carry_through(handshake(client, clock, lines), client.take))
        reading.values = dict.fromkeys(rig.channels, math.nan)
        for query in lines.queries:
            try:
                answer = client.ask(query)
            except WrongAnswer as wrong:
                reading.troubles.append(str(wrong))
                continue
            trips.append(answer.received - answer.sent)
            for name, text in answer.found.items():
                if name in rig.channels:
                    reading.values[name] = meaning.channel(name, text)
        reading.round_trip = median(trips) if trips else math.nan
    finally:
        port.close()
    return reading
