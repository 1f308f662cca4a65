"""Requests at given times, as a key or another terminal would make them."""

from __future__ import annotations

from dataclasses import dataclass, field

from rigctl.runner.operators.requests import Order, Request
from rigctl.runner.snapshot import View


@dataclass
class ScriptedControl:
    """Sends requests (pause, end, …) at given bench times, and keeps the answers and the published views.

    Attributes
    ----------
    orders: bench time, s, and the request at that time.
    answers: the acknowledgement of each.
    views: every published view of the run, in order.
    """

    orders: list[tuple[float, Request]] = field(default_factory=list)
    answers: list[str] = field(default_factory=list)
    views: list[View] = field(default_factory=list)
    time: float = 0.0

    def poll(self) -> list[Order]:
        """The requests that are due."""
        due = [request for when, request in self.orders if self.time >= when]
        self.orders = [(when, request) for when, request in self.orders if self.time < when]
        return [Order(request, "a test") for request in due]

    def acknowledge(self, order: Order, message: str) -> None:
        """Keep the acknowledgement of a request."""
        self.answers.append(message)

    def publish(self, view: View) -> None:
        """Keep a published view of the run."""
        self.time = view.time
        self.views.append(view)

    def close(self) -> None:
        """Nothing to close."""
