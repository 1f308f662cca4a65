"""Asks the device of a rig file who it is and for one value of every channel; nothing is set."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from statistics import median

from rigctl.backends.lines.handshake import handshake
from rigctl.backends.lines.meaning import Meaning
from rigctl.backends.lines.talk import Talk, WrongAnswer
from rigctl.backends.transport.address import Address
from rigctl.backends.transport.conversation import carry_through
from rigctl.clock import Clock
from rigctl.rig import Lines, Rig


@dataclass
class OneReading:
    """What a device has said.

    Attributes
    ----------
    identity: of the device, as far as it says it.
    values: SI, by channel; NaN where none was given.
    troubles: what was answered instead of values.
    round_trip: median of the questions, s.
    """

    identity: Mapping[str, str]
    values: dict[str, float] = field(default_factory=dict)
    troubles: list[str] = field(default_factory=list)
    round_trip: float = math.nan

    def impossible(self, rig: Rig) -> list[str]:
        """Channels whose values cannot be."""
        return [name for name, value in self.values.items() if not rig.channels[name].possible(value)]


def read_once(rig: Rig, lines: Lines, address: Address, clock: Clock) -> OneReading:
    """Reach a device, ask who it is, and read every channel once.

    Raises
    ------
    PortLost
        nobody answers.
    RigctlError
        somebody else answers, or the port may not be opened.
    """
    port = address.open(clock)
    try:
        talk, meaning, trips = Talk(port, clock, lines), Meaning(rig, lines), []
        reading = OneReading(carry_through(handshake(talk, clock, lines), talk.take))
        reading.values = dict.fromkeys(rig.channels, math.nan)
        for query in lines.queries:
            try:
                answer = talk.ask(query)
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
