"""The simulated bench's actuators: their commands, and what reaches the plant."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rigctl.backends.simulated.plant import Plant
from rigctl.rig import Rig


class Outputs:
    """The commanded values, and how they are passed to the plant.

    A faulty actuator is *seized*: its commands are recorded, but do not affect the plant until it is freed.
    The actual setting may have a relative scatter, such as that of an operator or a proportional valve.
    """

    def __init__(
        self,
        rig: Rig,
        plant: Plant,
        initial: Mapping[str, float],
        generator: np.random.Generator,
        scatter: Mapping[str, float],
    ) -> None:
        self._plant = plant
        self._generator = generator
        self._scatter = scatter
        self._seized: set[str] = set()
        self._commanded = {name: initial[name] for name in rig.layout.commands}
        self._row = tuple(self._commanded.values())
        for name, value in self._commanded.items():
            plant.switch(name, value)

    @property
    def row(self) -> tuple[float, ...]:
        """The last command of each actuator, SI, in the order of the rig's layout."""
        return self._row

    def switch(self, actuator: str, value: float) -> None:
        """Command an actuator to an SI value."""
        self._commanded[actuator] = value
        self._row = tuple(self._commanded.values())
        if actuator not in self._seized:
            self._act(actuator)

    def seize(self, actuator: str, value: float | None = None) -> None:
        """Make `actuator` ignore commands, after setting it to `value` if that is not None."""
        self._seized.add(actuator)
        if value is not None:
            self._plant.switch(actuator, value)

    def free(self, actuator: str) -> None:
        """Make an actuator follow its commands again; the latest one takes effect at once."""
        self._seized.discard(actuator)
        self._act(actuator)

    def _act(self, actuator: str) -> None:
        value = self._commanded[actuator]
        if actuator in self._scatter:
            value *= 1.0 + self._scatter[actuator] * float(self._generator.standard_normal())
        self._plant.switch(actuator, value)
