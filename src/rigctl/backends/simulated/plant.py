"""The interface of a simulated plant."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol


class Plant(Protocol):
    """The true quantities of a bench, as functions of time for piecewise constant inputs.

    Time is in s since the bench was opened, and only increases.
    """

    @property
    def channels(self) -> tuple[str, ...]:
        """The rig's channels in the order of `read`."""
        ...

    def advance(self, time: float) -> None:
        """Advance the plant to `time`, s, with constant inputs."""
        ...

    def switch(self, actuator: str, value: float) -> None:
        """Set an actuator to an SI value at the plant's current time."""
        ...

    def drives(self, actuator: str) -> bool:
        """Return whether any channel depends on an actuator; the others are switched without an effect."""
        ...

    def read(self) -> Sequence[float]:
        """Return the true SI values at the plant's current time, without noise."""
        ...

    def take_departures(self) -> Sequence[str]:
        """Return messages on the effects whose range of validity was left since the last call."""
        ...
