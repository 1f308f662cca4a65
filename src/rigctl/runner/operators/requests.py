"""Requests to a run in progress: pause, continue, end. From a key, another terminal, or a test."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from rigctl.runner.snapshot import View

#: longest response time to a key or another terminal, s of wall time
RESPONSE = 0.1


class Request(Enum):
    """The kinds of request."""

    PAUSE = "pause"
    CONTINUE = "continue"
    ABORT = "abort"


@dataclass(frozen=True)
class Order:
    """A request and its origin; `id` identifies it in the acknowledgement."""

    request: Request
    source: str
    id: str = ""


class Control(Protocol):
    """A source of requests, which is informed about the run."""

    def poll(self) -> Sequence[Order]:
        """Requests since the last call; must return at once."""
        ...

    def acknowledge(self, order: Order, message: str) -> None:
        """Acknowledge an order."""
        ...

    def publish(self, view: View) -> None:
        """Publish the state of the run; called ten times a second of wall time."""
        ...

    def close(self) -> None:
        """Close when the run is over; never raises."""
        ...
