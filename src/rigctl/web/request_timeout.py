"""A time-out for connections without a request: two hundred idle ones would block all other clients."""

from __future__ import annotations

import asyncio
from typing import Final

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

#: time-out for the head of a request, s
PATIENCE: Final = 5.0


class TimeoutProtocol(H11Protocol):
    """The HTTP protocol of uvicorn with a time-out for the head of a request, for which it has none."""

    _waiting: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Start the time-out for the first request."""
        super().connection_made(transport)
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
