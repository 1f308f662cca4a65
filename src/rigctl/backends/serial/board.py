"""A board that has answered: who it is, what time it has, and what made it trip."""

from __future__ import annotations

from collections.abc import Mapping

from rigctl.backends.serial.clock_map import ClockMap
from rigctl.backends.serial.line import Line

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

    def ask(self, command: str, tries: int = 3) -> str:
        """The answer to a command; raises `Refused` or `PortLost`."""
        return self.line.exchange(command, tries=tries)[1]

    def trips(self) -> int:
        """The latched causes."""
        return int(self.ask("SYST:TRIP?").partition(",")[0])

    def learn_clock(self, times: int) -> bool:
        """Ask for its time; False when it cannot be the time of the board that answered before."""
        for _ in range(times):
            sent, answer, received = self.line.exchange("SYST:TIME?")
            if not self.clock_map.add(sent, int(answer), received):
                return False
        return True


def trip_causes(bits: int) -> list[str]:
    """What the bits of a trip mean."""
    return [cause for bit, cause in enumerate(_CAUSES) if bits >> bit & 1]
