"""A board that has answered: who it is, what time it has, and what made it trip."""

from __future__ import annotations

from collections.abc import Mapping

from rigctl.backends.serial.clock_map import ClockMap
from rigctl.backends.serial.line import Line, Refused
from rigctl.backends.serial.port import PortLost
from rigctl.clock import Clock
from rigctl.errors import ExitCode, RigctlError

MAKER, KIND = "RIGCTL", "RIG-UNO"
VERSION = "1"  #: of the protocol: the firmware's first number
_CAUSES = (
    "over-temperature",
    "over-pressure",
    "host silent",
    "restarted by the MCU watchdog",
    "sensor open or shorted",
    "heater on for too long",
)
_ASK_AGAIN = 0.25  # s


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


def greet(line: Line, clock: Clock, patience: float) -> Board:
    """The board at the other end, once it answers; one that starts anew needs about 2 s.

    Raises
    ------
    PortLost
        nobody answers for `patience` s.
    RigctlError
        somebody answers who is no board of rigctl's, or has firmware of another protocol.
    """
    give_up = clock.now() + patience
    line.port.write(b"\n")  # whatever half of a command was left is over
    while True:
        try:
            maker, kind, serial, version = line.exchange("*IDN?", _ASK_AGAIN, tries=1)[1].split(",")
            break
        except PortLost:
            if clock.now() >= give_up:
                raise PortLost(_silence(line)) from None
        except (ValueError, Refused):
            raise _wrong("another device") from None
    if (maker, kind) != (MAKER, KIND):
        raise _wrong(f"{maker},{kind}")
    if version.partition(".")[0] != VERSION:
        raise RigctlError(
            "the board's firmware speaks another protocol",
            value=version,
            expected=f"{VERSION}.x",
            hint="Flash the image that comes with this rigctl",
            exit_code=ExitCode.FAILED,
        )
    configuration = line.ask("SYST:CONF?")
    return Board(
        line,
        {"port": line.port.name, "firmware": f"{kind} {version}", "serial": serial, "board": configuration},
    )


def _silence(line: Line) -> str:
    if line.heard:
        return f"{line.port.name}: what arrives is no answer; another device, firmware or baud rate"
    return f"{line.port.name}: nobody answers; is the board on this port, and flashed with rigctl's firmware?"


def _wrong(what: str) -> RigctlError:
    return RigctlError(
        "this is no board with rigctl's firmware",
        value=what,
        expected=f"{MAKER},{KIND}",
        hint="Check the port, or flash the image that comes with rigctl",
        exit_code=ExitCode.FAILED,
    )
