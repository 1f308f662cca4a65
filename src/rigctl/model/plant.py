"""The bench's equations as a simulation that is observed and commanded while it runs."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rigctl.effects.declaration import Effect
from rigctl.effects.registry import find_effect
from rigctl.errors import unknown_name
from rigctl.model.build import Effects, build_system
from rigctl.model.inputs import InputSource, input_sources, input_values
from rigctl.model.rig_family import family_of
from rigctl.physics.family import ModelFamily
from rigctl.rig.rig import Rig

if TYPE_CHECKING:
    from rigctl.engine.stepper import Stepper


@dataclass(frozen=True)
class PlantInputs:
    """The mapping from the rig's commands to the plant's inputs."""

    sources: tuple[InputSource, ...]

    def switched(self, actuator: str, commands: Mapping[str, float]) -> dict[str, float]:
        """The inputs that change with `actuator`, with their values for these commands (SI)."""
        return {
            source.input: source.of(commands)
            for source in self.sources
            if any(name == actuator for name, _ in source.actuators)
        }


def plant_inputs(rig: Rig, family: ModelFamily | None = None) -> PlantInputs:
    """The source of each input of the simulated bench; room temperature and pump are the simulation's.

    `family` is the rig's own by default.

    Raises
    ------
    RigctlError
        the rig names no family, or does not state its heater's power.
    """
    room = {
        "ambient_temperature": rig.simulation.ambient_temperature,
        "pump": 1.0 if rig.simulation.pump else 0.0,
    }
    return PlantInputs(input_sources(family or family_of(rig), rig, room))


def plant_stepper(
    rig: Rig,
    effects: Effects | None = None,
    parameters: Mapping[str, float] | None = None,
    *,
    initial: Mapping[str, float] | None = None,
    commands: Mapping[str, float] | None = None,
    own_effects: Iterable[Effect] = (),
    family: ModelFamily | None = None,
    progress: Callable[[str], None] | None = None,
) -> Stepper:
    """The bench that `rig` describes, with hidden effects, at time 0.

    Parameters
    ----------
    effects: by name, with their parameters (SI); missing parameters have their typical size.
    parameters: of the family, SI; they override the rig's.
    initial: states by name, SI; by default the channels' initial readings in the rig's simulation section,
        else the family's starts.
    commands: of the actuators at the start, SI; by default 0, and for a relief valve the initial supply
        pressure.
    own_effects: a user's effects, which may then be named in `effects`.
    family: of the equations; by default the one named by the rig.
    progress: called before a long operation, with its description.

    Raises
    ------
    RigctlError
        an unknown family, effect, parameter or state.
    """
    from rigctl.engine.compile import compile_system
    from rigctl.engine.stepper import Stepper

    chosen = family or family_of(rig)
    users = tuple(own_effects)
    # the equations, with every hidden effect at its typical size unless another is given
    hidden = _resolved(chosen, effects or {}, users)
    sizes = {effect.name: effect.start | dict((effects or {})[effect.name]) for effect in hidden}
    system = build_system(chosen, sizes, rig, parameters=parameters, own_effects=users)
    start = _initial(chosen, rig, initial or {}, hidden)
    # a relief valve is set to the pressure that the bench starts with, or it would start by losing it
    given = dict.fromkeys(rig.actuators, 0.0)
    role = rig.roles.set_pressure
    if role is not None and role.channel in start:
        given[role.actuator] = start[role.channel]
    inputs = input_values(plant_inputs(rig, chosen).sources, given | dict(commands or {}))
    compiled = compile_system(system, stepping=True, progress=progress)
    return Stepper(compiled, [start[name] for name in system.state_names], system.nominal, inputs)


def initial_state(
    family: ModelFamily, effects: Iterable[Effect], given: Mapping[str, float] | None = None
) -> dict[str, float]:
    """The initial state of a record: as given, else from the family and the effects.

    Raises
    ------
    RigctlError
        `given` names no state.
    """
    start = {state.name: state.start for state in family.states}
    for effect in effects:
        start |= {f"{effect.name}.{state.name}": state.start for state in effect.states}
    for name, value in (given or {}).items():
        if name not in start:
            raise unknown_name("state", name, start)
        start[name] = float(value)
    return start


def _initial(
    family: ModelFamily, rig: Rig, given: Mapping[str, float], effects: Iterable[Effect]
) -> dict[str, float]:
    known = {state.name for state in family.states}
    read = {name: float(value) for name, value in rig.simulation.initial.items() if name in known}
    return initial_state(family, effects, read | dict(given))


def _resolved(family: ModelFamily, names: Iterable[str], own_effects: Iterable[Effect]) -> list[Effect]:
    users = {effect.name: effect for effect in own_effects}
    return [users.get(name) or find_effect(name, family) for name in names]
