"""Reconnects a lost bench in small steps, without blocking a caller that is waiting for a sample.

In: what opens the port and what identifies the device. Out: the device, once it has been identified and
set up, or the end of the attempts: the time is over, or another device answers. The pause between two
attempts doubles, up to 2 s.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Generic, TypeVar

from rigctl.backends.errors import BackendLost
from rigctl.backends.transport.conversation import ActiveConversation, Conversation, Take
from rigctl.backends.transport.port import Connect, Port, PortLost, Refused
from rigctl.clock import Clock
from rigctl.errors import RigctlError

_FIRST_RETRY, _LONGEST_RETRY = 0.1, 2.0  # s, between two attempts

Device = TypeVar("Device")


class DeviceIdentification(Generic[Device]):
    """The identification of the device on a port that has just been opened.

    Parameters
    ----------
    port: the port.
    take: reads what arrives on it.
    conversation: identifies and sets up the device.
    """

    def __init__(self, port: Port, take: Take, conversation: Conversation[Device]) -> None:
        self.port = port
        self._take = take
        self._underway = ActiveConversation(_lost_if_refused(conversation))

    def go_on(self, until: float) -> Device | None:
        """Continue until about bench time `until`; return the device, or None if it takes longer."""
        if not self._underway.over:
            self._underway.take(self._take, until)
        return self._underway.result if self._underway.over else None

    def carry_through(self) -> Device:
        """Complete the identification, waiting for the answers; return the device."""
        while (device := self.go_on(self._underway.until)) is None:
            pass
        return device


def _lost_if_refused(conversation: Conversation[Device]) -> Conversation[Device]:
    """Treat a refusal of a set-up that worked before as a loss of contact, which may be temporary."""
    try:
        return (yield from conversation)
    except Refused as error:
        raise PortLost(str(error)) from None


class Reconnection(Generic[Device]):
    """Attempts with increasing intervals, until the bench answers or `limit` has passed.

    Parameters
    ----------
    connect: opens the port.
    identify: starts the identification.
    limit: s allowed for the bench to return.

    Attributes
    ----------
    since: time of the loss, s.
    why: the reason, as far as known.
    """

    def __init__(
        self,
        clock: Clock,
        connect: Connect,
        identify: Callable[[Port], DeviceIdentification[Device]],
        limit: float,
    ) -> None:
        self._clock = clock
        self._connect = connect
        self._identify = identify
        self._limit = limit
        self._identification: DeviceIdentification[Device] | None = None
        self._next_try = self._pause = 0.0
        self.since = math.nan
        self.why = ""

    def begin(self, why: str, still_open: Port | None = None) -> None:
        """Start after a loss, first on a port that is `still_open`."""
        self.since = self._next_try = self._clock.now()
        self._pause = _FIRST_RETRY
        self.why = why
        self._identification = None
        # Where only the answers failed to come, the port itself is kept: opening it again would restart many
        # boards.
        if still_open is not None:
            try:
                self._identification = self._identify(still_open)
            except PortLost:
                still_open.close()

    def attempt(self, until: float) -> Device | None:
        """Try until about bench time `until`; return the bench, or None if it is not ready yet.

        Raises
        ------
        BackendLost
            the limit has passed, or another device answers.
        """
        # Each call does one small step and returns: wait a little, open the port, or go on with the
        # identification. The caller samples other devices, and handles signals, in between.
        now = self._clock.now()
        if now - self.since > self._limit:
            self.drop()
            raise BackendLost(f"the bench did not come back within {self._limit:g} s: {self.why}")
        if self._identification is None and now < self._next_try:
            self._clock.sleep_until(min(self._next_try, until))
            return None
        try:
            if self._identification is None:
                self._identification = self._open(now)
            device = self._identification.go_on(until)
        # Temporary: the next attempt follows after a pause.
        except PortLost as error:
            self.why = str(error)
            self.drop()
            return None
        # Another device answers, or the right one cannot be set up: no further attempt would end otherwise.
        except RigctlError as error:
            self.drop()
            raise BackendLost(str(error)) from None
        if device is not None:
            self._identification = None  # the port now belongs to the bench
        return device

    def drop(self) -> None:
        """Close a port opened by an attempt."""
        if self._identification is not None:
            self._identification.port.close()
        self._identification = None

    def _open(self, now: float) -> DeviceIdentification[Device]:
        # Counted from the beginning of this attempt, which may itself take seconds.
        self._next_try = now + self._pause
        self._pause = min(2.0 * self._pause, _LONGEST_RETRY)
        try:
            port = self._connect()
        except RigctlError as error:  # a new port may lack permissions, or be probed
            raise PortLost(str(error)) from None
        try:
            return self._identify(port)
        except PortLost:
            port.close()
            raise
