"""Requests at given times, as a key or another terminal would make them."""

from __future__ import annotations

from dataclasses import dataclass, field

from rigctl.runner.requests import Order, Request
from rigctl.runner.snapshot import View


@dataclass
class ScriptedControl:
    """Asks for a pause, an end, … at bench times, and keeps what it was answered and shown.

    Attributes
    ----------
    orders: bench time in s, and what is asked for then.
    answers: what became of each.
    views: everything that was shown of the run, in order.
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
        """Keep what became of a request."""
        self.answers.append(message)

    def publish(self, view: View) -> None:
        """Keep what is shown of the run."""
        self.time = view.time
        self.views.append(view)

    def close(self) -> None:
        """Nothing to give back."""
