"""What somebody asks of a run in progress: pause, go on, end. From a key, another terminal, or a test."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from rigctl.runner.view import View

#: s of wall time that a key or another terminal may have to wait
RESPONSE = 0.1


class Request(Enum):
    """What can be asked."""

    PAUSE = "pause"
    CONTINUE = "continue"
    ABORT = "abort"


@dataclass(frozen=True)
class Order:
    """A request and where it comes from; `id` names it to whoever waits for the acknowledgement."""

    request: Request
    source: str
    id: str = ""


class Control(Protocol):
    """Somewhere that requests come from, and that is told about the run."""

    def poll(self) -> Sequence[Order]:
        """Requests since the last call; must return at once."""
        ...

    def acknowledge(self, order: Order, message: str) -> None:
        """What has become of an order."""
        ...

    def publish(self, view: View) -> None:
        """What the run is doing now; called ten times a second of wall time."""
        ...

    def close(self) -> None:
        """The run is over; never raises."""
        ...
