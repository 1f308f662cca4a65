"""Finds a lost board again, a little at a time, so that whoever waits for a sample is not held up."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Generic, Protocol, TypeVar

from rigctl.backends.errors import BackendLost
from rigctl.backends.serial.line import Refused
from rigctl.backends.serial.port import Connect, Port, PortLost
from rigctl.clock import Clock
from rigctl.errors import RigctlError

_FIRST_RETRY, _LONGEST_RETRY = 0.1, 2.0  # s, between two attempts

Met = TypeVar("Met")
Met_co = TypeVar("Met_co", covariant=True)


class Greeter(Protocol[Met_co]):
    """Asks who is at the other end of a port, a little at a time."""

    @property
    def port(self) -> Port:
        """The port that has been opened for it."""
        ...

    def ask(self, until: float) -> Met_co | None:
        """Who answers; None when nobody has by about bench time `until`."""
        ...


class Reconnection(Generic[Met]):
    """Attempts with growing distances, until the board answers or `limit` has passed.

    Parameters
    ----------
    connect: opens the port.
    greet: begins to ask who is there.
    limit: s for it to come back.

    Attributes
    ----------
    since: when the board was lost, s.
    why: what is known of the reason.
    """

    def __init__(
        self, clock: Clock, connect: Connect, greet: Callable[[Port], Greeter[Met]], limit: float
    ) -> None:
        self._clock = clock
        self._connect = connect
        self._greet = greet
        self._limit = limit
        self._greeting: Greeter[Met] | None = None
        self._next_try = self._pause = 0.0
        self.since = math.nan
        self.why = ""

    def begin(self, why: str, still_open: Port | None = None) -> None:
        """The board has just been lost; on a port that is `still_open` it is looked for first."""
        self.since = self._next_try = self._clock.now()
        self._pause = _FIRST_RETRY
        self.why = why
        self._greeting = None
        if still_open is not None:
            try:
                self._greeting = self._greet(still_open)
            except PortLost:
                still_open.close()

    def attempt(self, until: float) -> Met | None:
        """What can be done by about bench time `until`: the board when it answers, None when not yet.

        Raises
        ------
        BackendLost
            it has been away for too long, or another device answers.
        """
        now = self._clock.now()
        if now - self.since > self._limit:
            self.drop()
            raise BackendLost(f"the board did not come back within {self._limit:g} s: {self.why}")
        if self._greeting is None and now < self._next_try:
            self._clock.sleep_until(min(self._next_try, until))
            return None
        try:
            if self._greeting is None:
                self._greeting = self._open(now)
            board = self._greeting.ask(until)
        except (PortLost, Refused) as error:
            self.why = str(error)
            self.drop()
            return None
        except RigctlError as error:
            self.drop()
            raise BackendLost(str(error)) from None
        if board is not None:
            self._greeting = None  # the port is the board's now
        return board

    def drop(self) -> None:
        """Let the port go that an attempt has opened."""
        if self._greeting is not None:
            self._greeting.port.close()
        self._greeting = None

    def _open(self, now: float) -> Greeter[Met]:
        self._next_try = now + self._pause
        self._pause = min(2.0 * self._pause, _LONGEST_RETRY)
        try:
            port = self._connect()
        except RigctlError as error:  # a port that has just come back may not be ours yet, or be looked at
            raise PortLost(str(error)) from None
        try:
            return self._greet(port)
        except PortLost:
            port.close()
            raise
