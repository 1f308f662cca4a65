"""The bench as a model describes it: its equations, advanced from event to event."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from rigctl.backends.simulated.initial import initial_values
from rigctl.backends.simulated.truth import resting_state
from rigctl.engine.compile import compile_system
from rigctl.engine.stepper import Stepper
from rigctl.model import Model, input_sources
from rigctl.rig import Rig


class ModelPlant:
    """A model behind the channels and actuators of a rig.

    The rig's ``simulation`` gives the initial value of each state that has a channel, the ambient
    temperature, and whether the pump runs. A channel that neither the model nor its inputs know keeps its
    initial value.

    Parameters
    ----------
    rig: whose channels are read and whose actuators are switched.
    model: whose equations hold.
    progress: told when something takes long.
    """

    def __init__(self, rig: Rig, model: Model, progress: Callable[[str], None] | None = None) -> None:
        self.channels: tuple[str, ...] = rig.layout.channels
        self._commands = dict.fromkeys(rig.actuators, 0.0)
        surroundings = {
            "ambient_temperature": rig.simulation.ambient_temperature,
            "pump": float(rig.simulation.pump),
        }
        self._sources = input_sources(model.family, rig, surroundings)
        compiled = compile_system(model.system(), progress=progress)
        system = compiled.system
        initial, resting = initial_values(rig), resting_state(model)
        self._stepper = Stepper(
            compiled,
            [initial.get(name, resting[name]) for name in system.state_names],
            system.nominal,
            [source.of(self._commands) for source in self._sources],
        )
        given = {source.channel: source.value for source in self._sources if source.channel is not None}
        self._values = [given.get(name, initial[name]) for name in self.channels]
        outputs = system.output_names
        self._places = [
            (self.channels.index(name), outputs.index(name)) for name in outputs if name in self.channels
        ]

    def advance(self, time: float) -> None:
        """Let the plant run to `time`."""
        self._stepper.advance(time)

    def switch(self, actuator: str, value: float) -> None:
        """Put an actuator to an SI value."""
        self._commands[actuator] = value
        for source in self._sources:
            if any(name == actuator for name, _ in source.actuators):
                self._stepper.switch_input(source.input, source.of(self._commands))

    def read(self) -> Sequence[float]:
        """The true SI values."""
        outputs = self._stepper.outputs().tolist()
        for place, output in self._places:
            self._values[place] = outputs[output]
        return self._values
