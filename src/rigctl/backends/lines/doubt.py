"""The outputs of a device that may be on: commanded, and not known to be safe since."""

from __future__ import annotations

from collections.abc import Mapping

from rigctl.backends.lines.safe_state import SafeOutcome
from rigctl.backends.transport.port import AnotherDevice
from rigctl.backends.transport.safe_commands import Duty, Outputs


class InDoubt:
    """The outputs that may be on.

    A state that is read as safe ends the doubt about its output, until it turns out that another device may
    have answered.

    Parameters
    ----------
    safe_values: the safe values of the driven outputs, SI.
    duty: the state of the outputs as known to the guard.
    """

    def __init__(self, safe_values: Mapping[str, float], duty: Duty) -> None:
        self._safe_values = safe_values
        self._duty = duty
        self._on: dict[str, float] = {}
        self._driven: dict[str, float] = {}  # since the identified device was last confirmed to be safe

    @property
    def may_be_on(self) -> Mapping[str, float]:
        """The SI values that they may have."""
        return self._on

    def commanded(self, actuator: str, value: float) -> None:
        """Record a command to a value that is not the safe one."""
        self._duty.outputs = Outputs.DRIVEN
        self._on[actuator] = self._driven[actuator] = value

    def found(self, actuator: str, value: float) -> None:
        """Record the state of an output that was read, or answered where nothing reads it."""
        if value == self._safe_values.get(actuator):
            self._on.pop(actuator, None)
        elif actuator in self._safe_values:
            self._on[actuator] = value

    def exchanged(self) -> None:
        """Doubt everything: another device answers, and may have done so for some time."""
        self._on = self._driven | self._on
        # An output that was read as safe may have been read from the other device: all that was driven counts
        # again.
        if self._driven:
            self._duty.outputs = Outputs.DRIVEN

    def made_safe(self, outcome: SafeOutcome) -> None:
        """Record what the device has confirmed when it was made safe."""
        if isinstance(outcome.trouble, AnotherDevice):
            self.exchanged()
        for name in self._safe_values.keys() - outcome.doubtful.keys():
            self._on.pop(name, None)
        self._on |= {name: value for name, value in outcome.doubtful.items() if value is not None}
        # The guard is told the same: with SAFE it ends when the port is closed, with DRIVEN it goes on by
        # itself.
        if outcome.trouble is None:
            self._driven.clear()
            self._duty.outputs = Outputs.SAFE
        else:
            self._duty.outputs = Outputs.DRIVEN
