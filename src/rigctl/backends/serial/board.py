"""A board that has answered: who it is, what time it has, and what made it trip."""

from __future__ import annotations

from collections.abc import Mapping

from rigctl.backends.conversation import Conversation
from rigctl.backends.serial.clock_map import ClockMap
from rigctl.backends.serial.line import TRIES, Line

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
    clock_map: from its microseconds to the bench's clock.
    identity: name, firmware and the limits that were compiled in.
    """

    def __init__(self, line: Line, identity: Mapping[str, str]) -> None:
        self.line = line
        self.identity = identity
        self.clock_map = ClockMap()

    def asking(self, command: str, tries: int = TRIES) -> Conversation[str]:
        """The answer to a command; raises `Refused` or `PortLost`."""
        answer = yield from self.line.asking(command, tries=tries)
        return answer.text

    def asking_trips(self) -> Conversation[int]:
        """The latched causes."""
        answer = yield from self.asking("SYST:TRIP?")
        return int(answer.partition(",")[0])

    def learning_clock(self, times: int) -> Conversation[None]:
        """Ask for its time so many times."""
        for _ in range(times):
            answer = yield from self.line.asking("SYST:TIME?")
            self.clock_map.add(answer.sent, int(answer.text), answer.received)


def trip_causes(bits: int) -> list[str]:
    """What the bits of a trip mean."""
    return [cause for bit, cause in enumerate(_CAUSES) if bits >> bit & 1]
