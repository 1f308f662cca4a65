"""A connected board: its identity, clock and trips."""

from __future__ import annotations

from collections.abc import Mapping

from rigctl.backends.arduino.clock_map import ClockMap
from rigctl.backends.arduino.line import TRIES, Line
from rigctl.backends.transport.conversation import Conversation
from rigctl.backends.transport.port import Port

_CAUSES = (
    "over-temperature",
    "over-pressure",
    "host silent",
    "restarted by the MCU watchdog",
    "sensor open or shorted",
    "heater on for too long",
)


class Board:
    """One board on a line.

    Attributes
    ----------
    clock_map: conversion from the board's microseconds to the bench's clock.
    identity: name, firmware and compiled-in limits.
    """

    def __init__(self, line: Line, identity: Mapping[str, str]) -> None:
        self.line = line
        self.identity = identity
        self.clock_map = ClockMap()

    @property
    def port(self) -> Port:
        """The port of the board's line."""
        return self.line.port

    def asking(self, command: str, tries: int = TRIES) -> Conversation[str]:
        """Return the answer to a command; raises `Refused` or `PortLost`."""
        answer = yield from self.line.asking(command, tries=tries)
        return answer.text

    def asking_trips(self) -> Conversation[int]:
        """Query the latched causes of trips."""
        answer = yield from self.asking("SYST:TRIP?")
        return int(answer.partition(",")[0])

    def learning_clock(self, times: int) -> Conversation[None]:
        """Query the board's time `times` times, and update the clock map."""
        for _ in range(times):
            answer = yield from self.line.asking("SYST:TIME?")
            self.clock_map.add(answer.sent, int(answer.text), answer.received)


def trip_causes(bits: int) -> list[str]:
    """Return the causes for the bits of a trip."""
    return [cause for bit, cause in enumerate(_CAUSES) if bits >> bit & 1]
