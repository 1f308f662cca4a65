"""A family, some effects and a bench as one system of equations for the engine.

In: declarations, whose formulas are functions of a `Scope`, and values in SI. Out: a `System` of symbols. The
order is fixed: everything is declared, inputs become what really acted, the effects' terms are summed into
the slots of the family's formulas, and then each formula is called once and yields its equation.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from functools import partial

from rigctl.effects.declaration import Effect, qualified
from rigctl.effects.record_level import RECORD
from rigctl.effects.registry import find_effect, library
from rigctl.engine.symbols import Expr, Scalar
from rigctl.engine.system import Added, System, SystemBuilder, after, before
from rigctl.errors import RigctlError
from rigctl.model.reading_errors import CalibrationError, true_input
from rigctl.model.values import choices, parameter_values
from rigctl.physics.derived_slots import input_slot, parameter_slot, per_second
from rigctl.physics.families import find_family
from rigctl.physics.family import ModelFamily
from rigctl.physics.scope import Scope
from rigctl.physics.si_unit import si_unit
from rigctl.rig.rig import Rig

#: effects by name, each with some or all of its parameters in SI
Effects = Mapping[str, Mapping[str, float]]


def build_system(
    family: str | ModelFamily,
    effects: Effects | None = None,
    rig: Rig | None = None,
    *,
    parameters: Mapping[str, float] | None = None,
    oil: str | None = None,
    own_effects: Iterable[Effect] = (),
    unrecorded: Collection[str] = (),
    read_wrong: Sequence[CalibrationError] = (),
) -> System:
    """The equations of `family` with `effects`, for the channels and dimensions of `rig`.

    States are in the family's order, then the effects' own (``pressure_lag.deviation``). Parameters are those
    of the family that can be fitted, then the effects' (``piston_leakage.conductance``); dimensions that no
    fit changes are numbers in the equations. Outputs are those of the family that are channels of the rig, or
    all of them without a rig. An effect with its parameters at their null does not change any value, even in
    the last bit, and the order of `effects` does not matter.

    Parameters
    ----------
    effects: parameters of an effect that are not given have their null values.
    parameters: of the family, SI; they override the rig's.
    oil: instead of the rig's.
    own_effects: a user's effects, which may then be named in `effects`.
    unrecorded: inputs to which the parameter of that name of the effect `record` is added.
    read_wrong: errors of inputs' calibrations, parameters of an effect, taken off their readings.

    Raises
    ------
    RigctlError
        an unknown family, effect or parameter, or a term with the wrong dimension.
    """
    chosen = find_family(family) if isinstance(family, str) else family
    used = _find(chosen, effects or {}, own_effects)
    builder = SystemBuilder()
    # symbols by name, as formulas ask for them: states, inputs and parameters of the family, then the
    # effects' own
    given = parameter_values(chosen, rig, parameters, oil)
    known = _declare(builder, chosen, given)
    for effect, values in used:
        known |= _declare_effect(builder, effect, values)
    # under its name a formula then finds the input that acted: with the unknown of an unrecorded one, and
    # without the error of the sensor that read it
    known |= {name: known[name] + known[qualified(RECORD, name)] for name in unrecorded}
    for item in chosen.inputs:
        of_input = [one for one in read_wrong if one.channel == item.name]
        known[item.name] = true_input(known[item.name], of_input, known)
    # a slot is the sum of the terms of all effects in it, 0 without any; the order of the effects is sorted
    # (`_find`), so that the same model is the same code
    scope = Scope(
        chosen,
        known,
        additions=[addition for effect, _ in used for addition in effect.additions()],
        options=choices(chosen, rig),
    )
    _write_equations(builder, chosen, scope, [effect for effect, _ in used])
    # the equations are in an FMU: it gets the inputs with the effects on them, and its outputs are states
    # whose rate the engine does not know
    if chosen.program is not None:
        drives = [scope[name] + scope.total(input_slot(name)) for name in chosen.program.inputs]
        constants = {one.name: given[one.name] for one in chosen.parameters if one.fixed}
        units = [per_second(state.unit) for state in chosen.states]
        declared = {one.name: one for one in chosen.parameters}
        added = [
            Added(name, term, declared[name].low, declared[name].high)
            for name in chosen.program.parameters
            if isinstance(term := scope.total(parameter_slot(name)), Expr)
        ]
        builder.foreign(chosen.program.with_constants(constants), drives, added, units)
    for output in chosen.outputs:
        if rig is None or output.name in rig.channels:
            builder.output(output.name, output.unit, output.formula(scope))
    return builder.build()


def superset(
    family: str | ModelFamily, effects: Effects | None = None, own_effects: Iterable[Effect] = ()
) -> dict[str, dict[str, float]]:
    """`effects`, and every other effect at its null, for the system that a diagnosis differentiates.

    Parameters
    ----------
    own_effects: a user's effects, which are candidates like those of the library.

    Raises
    ------
    RigctlError
        an unknown family.
    """
    known = (*library(family).values(), *own_effects)
    off = {effect.name: effect.null for effect in known if effect.terms}
    return off | {effect: dict(values) for effect, values in (effects or {}).items()}


def _find(
    family: ModelFamily, effects: Effects, own_effects: Iterable[Effect]
) -> list[tuple[Effect, dict[str, float]]]:
    users = {effect.name: effect for effect in own_effects}
    result = []
    for name, values in sorted(effects.items()):
        effect = users.get(name) or find_effect(name, family)
        if effect.base:
            raise RigctlError(f"{name} is base physics, which every model has")
        for parameter in values:
            effect.parameter(parameter)
        result.append((effect, effect.null | dict(values)))
    return result


def _declare(builder: SystemBuilder, family: ModelFamily, values: Mapping[str, float]) -> dict[str, Scalar]:
    known: dict[str, Scalar] = {}
    for state in family.states:
        known[state.name] = builder.state(state.name, state.unit, state.scale)
    for item in family.inputs:
        known[item.name] = builder.input(item.name, item.unit)
    for parameter in family.parameters:
        value, unit = values[parameter.name], si_unit(parameter.unit)
        known[parameter.name] = (
            builder.constant(value, unit)
            if parameter.fixed
            else builder.parameter(parameter.name, unit, value)
        )
    return known


def _declare_effect(builder: SystemBuilder, effect: Effect, values: Mapping[str, float]) -> dict[str, Scalar]:
    known: dict[str, Scalar] = {}
    for state in effect.states:
        name = qualified(effect.name, state.name)
        known[name] = builder.state(name, state.unit, state.scale)
    for parameter in effect.parameters:
        name = qualified(effect.name, parameter.name)
        known[name] = builder.parameter(name, si_unit(parameter.unit), values[parameter.name])
    return known


def _write_equations(
    builder: SystemBuilder, family: ModelFamily, scope: Scope, effects: Iterable[Effect]
) -> None:
    for state in family.states:
        builder.equation(state.name, scope.rate(state.name))
    for effect in effects:
        for own_state in effect.states:
            rate = effect.bind(own_state.rate)(scope)
            builder.equation(qualified(effect.name, own_state.name), rate)
    for item in family.inputs:
        if item.delay is not None:
            _write_delay(builder, item.name, partial(item.delay, scope))


def _write_delay(builder: SystemBuilder, name: str, delay: Callable[[Scalar, Scalar], Scalar]) -> None:
    """Declare the delay of an input, unless nothing delays it."""
    # a delay may depend on the command before and after a switch, which are variables of their own; a number,
    # zero, is no delay, and costs nothing
    commanded = [
        builder.graph.variable(f(name), builder.graph.variables[name].declared) for f in (before, after)
    ]
    value = delay(*commanded)
    if isinstance(value, Expr):
        builder.delay(name, lambda *_: value)
