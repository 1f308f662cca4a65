"""A plant that is simulated with a model: its equations are integrated from event to event."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from rigctl.backends.simulated.initial import initial_commands, initial_values
from rigctl.model import Model, plant_inputs, plant_stepper
from rigctl.model.validity import RangeWatch
from rigctl.rig import Rig


class ModelPlant:
    """A plant whose true values are the outputs of a model.

    The rig's ``simulation`` gives the initial value of each state that has a channel, the ambient
    temperature, and whether the pump is running. A channel that is neither an output nor an input of the
    model keeps its initial value.

    Parameters
    ----------
    rig: its channels are read and its actuators switched.
    model: the model of the plant.
    progress: called when something takes long.
    """

    def __init__(self, rig: Rig, model: Model, progress: Callable[[str], None] | None = None) -> None:
        self.channels: tuple[str, ...] = rig.layout.channels
        self._commands = initial_commands(rig)
        self._inputs = plant_inputs(rig, model.family)
        initial = initial_values(rig)
        self._stepper = plant_stepper(
            rig,
            {
                effect: {name: value.si for name, value in parameters.items()}
                for effect, parameters in model.effects.items()
            },
            {parameter.name: model.values[parameter.name] for parameter in model.family.parameters},
            initial={s.name: initial[s.name] for s in model.family.states if _gives_initial(rig, s.name)},
            commands=self._commands,
            own_effects=model.own_effects,
            family=model.family,
            progress=progress,
        )
        given = {source.channel: source.value for source in self._inputs.sources if source.channel}
        self._values = [given.get(name, initial[name]) for name in self.channels]
        outputs = self._stepper.compiled.system.output_names
        self._ranges = RangeWatch(model, rig)
        self._places = [
            (self.channels.index(name), outputs.index(name)) for name in outputs if name in self.channels
        ]

    def advance(self, time: float) -> None:
        """Advance the plant to `time`."""
        self._stepper.advance(time)

    def switch(self, actuator: str, value: float) -> None:
        """Set an actuator to an SI value."""
        self._commands[actuator] = value
        for name, level in self._inputs.switched(actuator, self._commands).items():
            self._stepper.switch_input(name, level)

    def drives(self, actuator: str) -> bool:
        """Return whether an input of the model comes from the actuator."""
        return bool(self._inputs.switched(actuator, self._commands))

    def read(self) -> Sequence[float]:
        """Return the true SI values."""
        outputs = self._stepper.outputs().tolist()
        for place, output in self._places:
            self._values[place] = outputs[output]
        return self._values

    def take_departures(self) -> Sequence[str]:
        """Return messages on effects whose range of validity was left since the last call, each only once."""
        if not self._ranges.sides:
            return ()
        stepper = self._stepper
        system = stepper.compiled.system
        known = dict(zip(system.state_names, stepper.state.tolist(), strict=True))
        known |= dict(zip(system.input_names, stepper.acting_inputs.tolist(), strict=True))
        return self._ranges.left(known)


def _gives_initial(rig: Rig, state: str) -> bool:
    """Return whether the rig gives the initial value of a state, directly or by the ambient temperature."""
    if state not in rig.channels:
        return False
    return state in rig.simulation.initial or rig.channels[state].quantity == "temperature"
