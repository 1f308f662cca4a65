"""Every effect of every family: sound, and exactly off at its null values."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rigctl.effects import Effect, EffectParameter, find_effect, library
from rigctl.effects.declaration import problems
from rigctl.effects.registry import check_effect
from rigctl.engine.symbols import evaluate
from rigctl.engine.system import System, after, before
from rigctl.errors import RigctlError
from rigctl.model import build_system, superset
from rigctl.physics.families import FAMILIES, find_family

EVERY = [effect for family in FAMILIES for effect in library(family).values()]
WITH_TERMS = [effect for effect in EVERY if effect.terms]


def label(effect: Effect) -> str:
    return f"{effect.family}-{effect.name}"


@pytest.mark.parametrize("effect", EVERY, ids=label)
def test_declarations_are_sound(effect: Effect) -> None:
    assert problems(effect, find_family(effect.family)) == []
    assert set(effect.confused_with) <= set(library(effect.family))
    assert effect.name not in effect.confused_with
    for text in (effect.summary, effect.equation, effect.source, effect.looks_like):
        assert text.strip()


@pytest.mark.parametrize("effect", EVERY, ids=label)
def test_every_bound_is_declared_as_physical_or_usual(effect: Effect) -> None:
    for parameter in effect.parameters:
        assert parameter.physical is not None
        if parameter.sign == 1:  # a one-sided parameter is bounded at its null value by physics
            assert parameter.physical in ("low", "both")
        low, high = parameter.widest
        assert low <= parameter.low < parameter.high <= high
        assert (low < parameter.low) is (parameter.physical in ("none", "high"))
        assert (high > parameter.high) is (parameter.physical in ("none", "low"))


def test_an_undeclared_bound_is_usual_unless_it_is_the_null_value() -> None:
    force = EffectParameter("force", "N", 0.0, 100.0, 0.0, 2e3, "F")
    assert (force.usual, force.widest) == ((False, True), (0.0, 2e4))
    width = EffectParameter("width", "mm", None, 1e-3, 1e-4, 1e-2, "w")
    assert width.usual == (True, True)
    assert width.widest == (pytest.approx(1e-5), pytest.approx(1e-3 + 10.0 * 9e-3))
    assert force.bounds_around(50.0) == (0.0, 2e3)
    assert force.bounds_around(3e3) == (0.0, 2e4)


def test_an_order_of_two_parameters_must_be_satisfiable() -> None:
    stribeck = find_effect("stribeck_friction", "hydraulic_cylinder")
    order = {one.name: one.at_least for one in stribeck.parameters if one.at_least}
    assert order == {"static_force": "force"}
    for name, wrong in (("speed", "must name another"), ("force", "null and start must be at least")):
        low = EffectParameter("static_force", "N", 0.0, 20.0, 0.0, 4e3, "F_s", at_least=name)
        kept = [low if one.name == "static_force" else one for one in stribeck.parameters]
        found = problems(replace(stribeck, parameters=tuple(kept)), find_family(stribeck.family))
        assert [wrong in one for one in found] == [True]


#: working range of the variables that the family gives no value
RANGES = {
    "oil_temperature": (280.0, 360.0),
    "spool": (-1.0, 1.0),
    "supply_pressure": (1e5, 60e5),
    "pressure_a": (-0.9e5, 50e5),
    "pressure_b": (-0.9e5, 50e5),
    "position": (-1e-5, 0.25),
    "velocity": (-0.3, 0.3),
    "valve": (-1.0, 1.0),
    "heater_power": (0.0, 2000.0),
    "pressure_setpoint": (10e5, 60e5),
    "ambient_temperature": (285.0, 300.0),
    "pump": (0.0, 1.0),
    "temperature_1": (290.0, 370.0),
    "temperature_2": (290.0, 370.0),
    "heater_1": (0.0, 1.0),
    "heater_2": (0.0, 1.0),
    "pressure": (0.0, 500e5),
}


def random_values(system: System, seed: int) -> dict[str, float]:
    """A random state within the working range, and the nominal parameters."""
    rng = np.random.default_rng(seed)
    values = dict(zip(system.parameter_names, system.nominal, strict=True))
    for name in (*system.state_names, *system.input_names):
        # an effect's own states may have any value while it is off
        values[name] = rng.uniform(*RANGES[name]) if name in RANGES else rng.uniform(-1, 1)
    for name in system.input_names:
        values[before(name)] = 0.0
        values[after(name)] = float(rng.integers(-1, 2))
    return values


def compare_bits(base: System, other: System) -> None:
    outputs = {output.name: output.expr for output in other.outputs}
    for seed in range(20):
        values = random_values(other, seed)
        for state, rate in zip(base.state_names, base.rhs, strict=True):
            there = other.rhs[other.state_names.index(state)]
            assert evaluate(there, values) == evaluate(rate, values), state
        for output in base.outputs:
            assert evaluate(outputs[output.name], values) == evaluate(output.expr, values), output.name
        for delay in other.delays:
            assert evaluate(delay.expr, values) == 0.0


@pytest.mark.parametrize("effect", WITH_TERMS, ids=label)
def test_an_effect_at_null_leaves_the_equations_bit_identical(effect: Effect) -> None:
    compare_bits(build_system(effect.family), build_system(effect.family, {effect.name: {}}))


@pytest.mark.parametrize("effect", WITH_TERMS, ids=label)
def test_an_effect_of_typical_size_changes_the_equations(effect: Effect) -> None:
    # a pressure-dependent viscosity acts only together with a term that contains the viscosity
    helper = {"viscous_friction": {"coefficient": 500.0}} if effect.family == "hydraulic_cylinder" else {}
    used = {name: values for name, values in helper.items() if name != effect.name}
    base = build_system(effect.family, used)
    other = build_system(effect.family, used | {effect.name: effect.start})
    outputs = {output.name: output.expr for output in other.outputs}
    different = []
    for seed in range(5):
        values = random_values(other, seed)
        for state, rate in zip(base.state_names, base.rhs, strict=True):
            there = other.rhs[other.state_names.index(state)]
            different.append(evaluate(there, values) != evaluate(rate, values))
        different.extend(
            evaluate(outputs[output.name], values) != evaluate(output.expr, values) for output in base.outputs
        )
        different.extend(evaluate(delay.expr, values) != 0.0 for delay in other.delays)
    assert any(different)


@pytest.mark.parametrize("family", FAMILIES)
def test_the_whole_library_at_null_leaves_the_equations_bit_identical(family: str) -> None:
    compare_bits(build_system(family), build_system(family, superset(family)))


def test_an_unknown_effect_is_refused_with_the_nearest_name() -> None:
    with pytest.raises(RigctlError, match="did you mean 'piston_leakage'"):
        find_effect("piston_leak", "hydraulic_cylinder")


def test_an_unsound_effect_is_refused_with_all_its_errors() -> None:
    effect = Effect(
        name="mine",
        family="hydraulic_cylinder",
        summary="s",
        equation="e",
        source="s",
        looks_like="l",
        terms=(("frictoin", lambda m, p: 0.0),),
    )
    with pytest.raises(RigctlError, match=r"unknown slot 'frictoin'.*no parameter switches it off"):
        check_effect(effect)


def test_a_term_of_the_wrong_dimension_is_refused() -> None:
    wrong = Effect(
        name="mine",
        family="hydraulic_cylinder",
        summary="s",
        equation="e",
        source="s",
        looks_like="l",
        terms=(("friction", lambda m, p: p.size * m.pressure_a),),
        parameters=(EffectParameter("size", "N", 0.0, 1.0, 0.0, 2.0, "f"),),
    )
    with pytest.raises(RigctlError, match="the term of mine at friction has the dimension"):
        build_system("hydraulic_cylinder", {"mine": {}}, own_effects=[wrong])
