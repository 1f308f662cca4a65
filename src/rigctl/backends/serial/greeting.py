"""Who is at the other end of a line that has just been opened."""

from __future__ import annotations

import math

from rigctl.backends.serial.board import Board
from rigctl.backends.serial.line import Line, Refused
from rigctl.backends.serial.port import Port, PortLost
from rigctl.clock import Clock
from rigctl.errors import ExitCode, RigctlError

MAKER, KIND = "RIGCTL", "RIG-UNO"
VERSION = "1"  #: of the protocol: the firmware's first number
_ASK_AGAIN = 0.25  # s
_SHORTEST = 0.05  # s; an answer takes a tenth of it


class Greeting:
    """Asks who is there until somebody answers; a board that starts anew needs about 2 s.

    Parameters
    ----------
    line: just opened.
    patience: s until nobody will answer any more.

    Raises
    ------
    PortLost
        the port is gone already.
    """

    def __init__(self, line: Line, clock: Clock, patience: float) -> None:
        self.line = line
        self._clock = clock
        self._give_up = clock.now() + patience
        line.port.write(b"\n")  # whatever half of a command was left is over

    @property
    def port(self) -> Port:
        """The port that has been opened for it."""
        return self.line.port

    def ask(self, until: float = math.inf) -> Board | None:
        """Ask once; None when nobody has answered by about bench time `until`.

        Raises
        ------
        PortLost
            nobody has answered for as long as patience lasts.
        RigctlError
            somebody answers who is no board of rigctl's, or has firmware of another protocol.
        """
        now = self._clock.now()
        timeout = min(_ASK_AGAIN, max(until - now, _SHORTEST))
        try:
            answer = self.line.exchange("*IDN?", timeout, tries=1)[1]
        except PortLost:
            if self._clock.now() >= self._give_up:
                raise PortLost(_silence(self.line)) from None
            return None
        except Refused:
            raise _wrong("another device") from None
        return self._board(answer)

    def _board(self, answer: str) -> Board:
        try:
            maker, kind, serial, version = answer.split(",")
        except ValueError:
            raise _wrong(answer) from None
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
        identity = {"port": self.line.port.name, "firmware": f"{kind} {version}", "serial": serial}
        return Board(self.line, {**identity, "board": self.line.ask("SYST:CONF?")})


def greet(line: Line, clock: Clock, patience: float) -> Board:
    """The board at the other end, once it answers; raises as `Greeting` does."""
    greeting = Greeting(line, clock, patience)
    while True:
        board = greeting.ask()
        if board is not None:
            return board


def _silence(line: Line) -> str:
    name = line.port.name
    if line.heard:
        return f"{name}: what arrives is no answer; another device, firmware or speed than {line.baud} baud"
    return f"{name}: nobody answers at {line.baud} baud; is it the port, its speed, or other firmware?"


def _wrong(what: str) -> RigctlError:
    return RigctlError(
        "this is no board with rigctl's firmware",
        value=what,
        expected=f"{MAKER},{KIND}",
        hint="Check the port, or flash the image that comes with rigctl",
        exit_code=ExitCode.FAILED,
    )
