"""A virtual clock with scheduled actions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from rigctl.clock import VirtualClock


@dataclass
class ScriptedClock(VirtualClock):
    """A virtual clock that calls scheduled actions at their times: e.g. a plug pulled at 3 s."""

    actions: list[tuple[float, Callable[[], object]]] = field(default_factory=list)

    def at(self, time: float, action: Callable[[], object]) -> None:
        """Call `action` when bench time `time` (s) is reached."""
        self.actions.append((time, action))
        self.actions.sort(key=lambda entry: entry[0])

    def sleep_until(self, when: float) -> None:
        """Let time pass, and call the actions that are due."""
        while self.actions and self.actions[0][0] <= when:
            time, action = self.actions.pop(0)
            super().sleep_until(time)
            action()
        super().sleep_until(when)
