"""Limits for connections: a time-out for the head of a request, and for their number.

Any program of this computer can connect, and any page that is open in a browser. None of them may keep the
user out, least of all from switching everything off.
"""

from __future__ import annotations

import asyncio
from typing import Final

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

from rigctl.web.access_control import SESSION

#: time-out for the head of a request, s
PATIENCE: Final = 5.0
#: connections at a time; for one more, the one of a stranger that has been open for longest is closed
MOST_CONNECTIONS: Final = 150


class TimeoutProtocol(H11Protocol):
    """The HTTP protocol of uvicorn with these limits.

    Its own limit of connections would refuse the newest one, which may be the user's.
    """

    _waiting: asyncio.TimerHandle | None = None
    since = 0.0

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Start the time-out for the first request."""
        super().connection_made(transport)
        self.since = self.loop.time()
        self._make_room()
        self._wait()

    def data_received(self, data: bytes) -> None:
        """Keep the time-out running until the head is complete."""
        super().data_received(data)
        if self.conn.their_state is not h11.IDLE:
            self._stop()
        elif self.conn.trailing_data[0]:
            self._wait()

    def connection_lost(self, exc: Exception | None) -> None:
        """Cancel the time-out."""
        self._stop()
        super().connection_lost(exc)

    def _make_room(self) -> None:
        """Close a connection if there are too many: without a session, or else without a request."""
        if len(self.connections) <= MOST_CONNECTIONS:
            return
        closable = [
            one
            for one in self.connections
            if isinstance(one, TimeoutProtocol) and one is not self and not (one.is_known and one.is_busy)
        ]
        if closable:
            oldest = min(closable, key=lambda one: (one.is_known, one.since))
            oldest.transport.abort()  # a client that does not read would keep it open

    @property
    def is_known(self) -> bool:
        """Whether its last request had the cookie of a session; `Gate` states it."""
        return bool(self.scope and self.scope.get(SESSION))

    @property
    def is_busy(self) -> bool:
        """Whether it is being answered."""
        return self.cycle is not None and not self.cycle.response_complete

    def _wait(self) -> None:
        if self._waiting is None:
            self._waiting = self.loop.call_later(PATIENCE, self._give_up)

    def _stop(self) -> None:
        if self._waiting is not None:
            self._waiting.cancel()
            self._waiting = None

    def _give_up(self) -> None:
        self._waiting = None
        # a connection upgraded to a WebSocket is no longer in the set of HTTP connections
        if self in self.connections and self.conn.their_state is h11.IDLE:
            self.transport.close()
