"""The trajectory of the standard record, as points at which a term can be evaluated."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from rigctl.effects.declaration import Effect, qualified
from rigctl.engine.compile import Progress, compile_system
from rigctl.engine.simulate import simulate
from rigctl.engine.system import after, before
from rigctl.engine.trajectories import Trajectories
from rigctl.model.build import build_system
from rigctl.model.standard_record import standard_excitation
from rigctl.physics.family import ModelFamily
from rigctl.physics.family_checks import Point
from rigctl.physics.standard_record import StandardRecord
from rigctl.rig.rig import Rig

#: one in this many samples of the record is kept
_EVERY = 15


def record_points(
    family: ModelFamily,
    rig: Rig | None = None,
    *,
    alongside: Sequence[tuple[Effect, Mapping[str, float]]] = (),
    progress: Progress | None = None,
) -> tuple[Point, ...]:
    """Values of the model's variables by name (SI) along the family's standard record, base physics alone.

    Parameters
    ----------
    alongside: effects present as well, with their parameters (SI).

    Raises
    ------
    RigctlError
        the record cannot be simulated.
    """
    used = [other for other, _ in alongside if other.terms]
    sizes = {other.name: dict(values) for other, values in alongside if other.terms}
    system = build_system(family, sizes, rig, own_effects=used)
    effect_starts = {qualified(each.name, state.name): state.start for each in used for state in each.states}
    excitation = standard_excitation(family, system, system.nominal, effect_starts)
    simulated = simulate(compile_system(system, progress=progress), [excitation]).require()
    parameters = dict(zip(system.parameter_names, system.nominal, strict=True))
    record = family.standard_record
    return tuple(_points(family, record, parameters, simulated)) if record is not None else ()


def _points(
    family: ModelFamily, record: StandardRecord, parameters: Mapping[str, float], simulated: Trajectories
) -> Iterator[Point]:
    commands = {item.name: item.value for item in family.inputs}
    switches = list(record.switches)
    fixed = {p.name: p.value for p in family.parameters}
    for index in range(0, len(simulated.times[0]), _EVERY):
        # a delay depends on the command before and after a switch; between switches both are the same
        earlier = dict(commands)
        while switches and switches[0][0] <= simulated.times[0][index]:
            commands |= switches.pop(0)[1]
        point = fixed | dict(parameters) | commands
        point |= dict(zip(simulated.state_names, simulated.states[0][index].tolist(), strict=True))
        point |= {before(name): value for name, value in earlier.items()}
        yield point | {after(name): value for name, value in commands.items()}
