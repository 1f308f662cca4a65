"""The signature of an effect: the change of the readings on the standard record."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.effects.contradiction import refuse_contradictions
from rigctl.effects.declaration import Effect, qualified
from rigctl.engine.compile import Progress, compile_system
from rigctl.engine.simulate import simulate
from rigctl.engine.tolerance import TIGHT
from rigctl.engine.trajectories import Trajectories
from rigctl.model.build import build_system
from rigctl.model.standard_record import standard_excitation, standard_record
from rigctl.physics.standard_record import StandardRecord
from rigctl.rig.rig import Rig

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Signature:
    """The standard record of an effect's family, simulated with the effect off and at its typical size.

    Attributes
    ----------
    effect: its name.
    record: the commands.
    times: (samples), in s.
    output_names, output_units: of the readings; SI.
    without, present: (samples, outputs).
    slopes: (samples, outputs, parameters) derivatives of the readings by the parameters that switch the
        effect, where it is off; no columns for base physics.
    slopes_present: the same at its typical size, by all its parameters.
    """

    effect: str
    record: StandardRecord
    times: Floats
    output_names: tuple[str, ...]
    output_units: tuple[str, ...]
    without: Floats
    present: Floats
    slopes: Floats
    slopes_present: Floats

    @property
    def difference(self) -> Floats:
        """(samples, outputs) the change due to the effect."""
        return self.present - self.without

    @property
    def silent(self) -> bool:
        """True if no reading depends on any of its parameters."""
        return not self.slopes_present.any() and not self.slopes.any()

    @property
    def flat_at_null(self) -> bool:
        """True if it has a signature at its typical size, but none to first order at its null."""
        return not self.silent and self.slopes.shape[2] > 0 and not self.slopes.any()


def signature(
    effect: Effect,
    rig: Rig | None = None,
    *,
    alongside: Sequence[tuple[Effect, Mapping[str, float]]] = (),
    progress: Progress | None = None,
) -> Signature:
    """Simulate the standard record without `effect` and with it, at its typical size.

    Base physics is removed instead: `without` is the result without it.

    Parameters
    ----------
    rig: its channels, dimensions and options are used; by default the family's, and everything it can read.
    alongside: effects present in both simulations, with their parameters (SI).

    Raises
    ------
    RigctlError
        the record cannot be simulated, or one of `alongside` contradicts the effect.
    """
    family = effect.model_family
    # one system for both simulations, in which parameters switch the effect: where it is off, the derivatives
    # by them are what it would change first
    used = [each for each in (effect, *(other for other, _ in alongside)) if each.terms]
    refuse_contradictions(used)
    sizes = {other.name: dict(values) for other, values in alongside} | {effect.name: effect.start}
    system = build_system(family, {each.name: sizes[each.name] for each in used}, rig, own_effects=used)
    compiled, record = compile_system(system, progress=progress), standard_record(family)
    nominal = dict(zip(system.parameter_names, system.nominal, strict=True))
    effect_starts = {qualified(each.name, state.name): state.start for each in used for state in each.states}

    def run(values: Mapping[str, float], columns: Iterable[str]) -> Trajectories:
        parameters = list((nominal | dict(values)).values())
        excitation = standard_excitation(family, system, parameters, effect_starts)
        return simulate(compiled, [excitation], columns=tuple(columns), tolerance=TIGHT).require()

    # derivatives at the null are what a score test sees of the effect; at its typical size shapes act too
    null = {qualified(effect.name, name): value for name, value in effect.null.items()} | dict(effect.base)
    switching = [qualified(effect.name, p.name) for p in effect.parameters if not p.shape]
    off = run(null, switching)
    on = run({}, [qualified(effect.name, p.name) for p in effect.parameters] + list(effect.base))
    return Signature(
        effect=effect.name,
        record=record,
        times=off.times[0],
        output_names=system.output_names,
        output_units=tuple(output.unit for output in system.outputs),
        without=off.outputs[0],
        present=on.outputs[0],
        slopes=off.sensitivities[0],
        slopes_present=on.sensitivities[0],
    )
