"""Gets hold of a device: who it is, and getting it back when it was lost."""

from __future__ import annotations

from collections.abc import Mapping

from rigctl.backends.errors import BackendLost
from rigctl.backends.lines.talk import Refused, Talk
from rigctl.backends.serial.port import Connect, PortLost
from rigctl.clock import Clock
from rigctl.errors import ExitCode, RigctlError
from rigctl.rig import Lines

_FIRST_RETRY, _LONGEST_RETRY = 0.1, 2.0  # s, between two attempts to reconnect
_FIRST_SILENCE = 0.3  # s that a device needs to throw away half a command


class Reach:
    """Opens the port, and opens it again with growing pauses after it was lost.

    Attributes
    ----------
    lost_at: when, s.
    why: what was last in the way.
    """

    def __init__(self, connect: Connect, clock: Clock, lines: Lines, patience: float) -> None:
        self._connect = connect
        self._clock = clock
        self._lines = lines
        self._patience = patience
        self._next_try = self._pause = 0.0
        self.lost_at = 0.0
        self.why = ""

    def first(self) -> Talk:
        """The device's line; raises `PortLost` or, where it never will be, `RigctlError`."""
        return Talk(self._connect(), self._clock, self._lines)

    def lost(self, error: PortLost) -> None:
        """The line is gone."""
        now = self._clock.now()
        self.lost_at, self.why = now, str(error)
        self._pause, self._next_try = _FIRST_RETRY, now

    def again(self, until: float) -> Talk | None:
        """One attempt, when it is due; sleeps until bench time `until` at the most.

        Raises
        ------
        BackendLost
            it has been away for too long.
        """
        now = self._clock.now()
        if now - self.lost_at > self._patience:
            raise BackendLost(f"the device did not come back within {self._patience:g} s: {self.why}")
        if now < self._next_try:
            self._clock.sleep_until(min(self._next_try, until))
            return None
        self._next_try = now + self._pause
        self._pause = min(2.0 * self._pause, _LONGEST_RETRY)
        try:
            return self.first()
        except PortLost as error:
            self.why = str(error)
            return None


def greet(talk: Talk, clock: Clock, lines: Lines) -> Mapping[str, str]:
    """Ask who it is until it answers; what stands in the places of its answer.

    A device that cannot say who it is must answer the first query instead.

    Raises
    ------
    PortLost
        nobody answers while the device may still be waking up.
    RigctlError
        somebody else answers.
    """
    give_up = clock.now() + lines.wake
    question = lines.identify or lines.queries[0]
    talk.port.write(lines.send_ends.encode("utf-8"))  # whatever half of a command was left is over
    talk.idle(clock.now() + _FIRST_SILENCE)
    while True:
        try:
            answer = talk.ask(question, tries=1)
            return answer.found if lines.identify is not None else {}
        except Refused as error:
            if clock.now() >= give_up:
                raise RigctlError(
                    "another device is on this port, or it speaks at another baud rate",
                    value=error.answer,
                    expected=" / ".join(question.reply),
                    exit_code=ExitCode.FAILED,
                ) from None
        except PortLost as error:
            if clock.now() >= give_up:
                heard = "what arrives is no answer; another baud rate?" if talk.heard else "nobody answers"
                raise PortLost(f"{talk.port.name}: {heard}") from error
