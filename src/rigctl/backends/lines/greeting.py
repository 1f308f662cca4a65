"""Who is at the other end of a line to a device that is described by its lines."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from rigctl.backends.lines.talk import Refused, Talk
from rigctl.backends.serial.port import Port, PortLost
from rigctl.clock import Clock
from rigctl.errors import ExitCode, RigctlError
from rigctl.rig import Lines

_FIRST_SILENCE = 0.3  # s that a device needs to throw away half a command
_SHORTEST = 0.05  # s for an answer


@dataclass(frozen=True)
class Device:
    """A device that has answered: the line to it, and what it says of itself."""

    talk: Talk
    identity: Mapping[str, str]


class Greeting:
    """Asks who is there until somebody answers.

    A device that cannot say who it is must answer the first query instead.

    Raises
    ------
    PortLost
        the port is gone already.
    """

    def __init__(self, port: Port, clock: Clock, lines: Lines) -> None:
        self._talk = Talk(port, clock, lines)
        self._clock = clock
        self._lines = lines
        self._question = lines.identify or lines.queries[0]
        self._give_up = clock.now() + lines.wake
        self._quiet_until = clock.now() + _FIRST_SILENCE
        port.write(lines.send_ends.encode("utf-8"))  # whatever half of a command was left is over

    @property
    def port(self) -> Port:
        """The port that has been opened for it."""
        return self._talk.port

    def ask(self, until: float = math.inf) -> Device | None:
        """Ask once; None when nobody has answered by about bench time `until`.

        Raises
        ------
        PortLost
            nobody answers while the device may still be waking up.
        RigctlError
            somebody else answers.
        """
        now = self._clock.now()
        if now < self._quiet_until:
            self._talk.idle(min(self._quiet_until, until))
            return None
        timeout = min(self._lines.timeout, max(until - now, _SHORTEST))
        try:
            found = self._talk.ask(self._question, tries=1, timeout=timeout).found
        except Refused as error:
            if self._clock.now() < self._give_up:
                return None
            raise RigctlError(
                "another device is on this port, or it speaks at another baud rate",
                value=error.answer,
                expected=" / ".join(self._question.reply),
                exit_code=ExitCode.FAILED,
            ) from None
        except PortLost as error:
            if self._clock.now() < self._give_up:
                return None
            heard = "what arrives is no answer; another baud rate?" if self._talk.heard else "nobody answers"
            raise PortLost(f"{self.port.name}: {heard}") from error
        return Device(self._talk, found if self._lines.identify is not None else {})


def greet(port: Port, clock: Clock, lines: Lines) -> Device:
    """The device at the other end, once it answers; raises as `Greeting` does."""
    greeting = Greeting(port, clock, lines)
    while True:
        device = greeting.ask()
        if device is not None:
            return device
