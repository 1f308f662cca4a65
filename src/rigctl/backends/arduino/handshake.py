"""Identifies the board on a line that has just been opened."""

from __future__ import annotations

from rigctl.backends.arduino.board import Board
from rigctl.backends.arduino.line import Line
from rigctl.backends.transport.conversation import Conversation
from rigctl.backends.transport.port import NoAnswer, PortLost, Refused
from rigctl.errors import ExitCode, RigctlError

MAKER, KIND = "RIGCTL", "RIG-UNO"
VERSION = "1"  #: version of the protocol: the first number of the firmware's version
_ASK_AGAIN = 0.25  # s


def handshake(line: Line, patience: float) -> Conversation[Board]:
    """Query the identity until there is an answer; a board that restarts needs about 2 s.

    Parameters
    ----------
    line: just opened.
    patience: time-out, s.

    Raises
    ------
    PortLost
        there was no answer within `patience`, or the port is gone.
    RigctlError
        the device is not a rigctl board, or its firmware has another version of the protocol.
    """
    give_up = line.clock.now() + patience
    line.port.write(b"\n")  # terminates any incomplete command
    while True:
        try:
            answer = yield from line.asking("*IDN?", _ASK_AGAIN, tries=1)
            break
        except NoAnswer:
            if line.clock.now() >= give_up:
                raise PortLost(_silence(line)) from None
        except Refused:
            raise _wrong("another device") from None
    identity = _identity(line, answer.text)
    configuration = yield from line.asking("SYST:CONF?")
    return Board(line, {**identity, "board": configuration.text})


def _identity(line: Line, answer: str) -> dict[str, str]:
    """Parse a board's answer to ``*IDN?``."""
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
    return {"port": line.port.name, "firmware": f"{kind} {version}", "serial": serial}


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
