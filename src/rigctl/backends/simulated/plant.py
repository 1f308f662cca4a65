"""What the simulated bench needs of whatever it simulates."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol


class Plant(Protocol):
    """True quantities that develop in time under switched inputs.

    Time is counted in s from the moment the bench was opened, and only goes forward.
    """

    @property
    def channels(self) -> tuple[str, ...]:
        """The rig's channels in the order in which `read` gives them."""
        ...

    def advance(self, time: float) -> None:
        """Let the plant run to `time` with its inputs as they are."""
        ...

    def switch(self, actuator: str, value: float) -> None:
        """Put an actuator to an SI value at the time the plant has reached."""
        ...

    def read(self) -> Sequence[float]:
        """The true SI values at the time the plant has reached, without noise."""
        ...

    def take_departures(self) -> Sequence[str]:
        """In words, the ranges of laws of the plant's effects that it has left since it was last asked."""
        ...
