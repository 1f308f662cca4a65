"""A law whose fit has reduced to a nested one is not distinguished from it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rigctl.analysis.laws.simpler_law import simpler_laws
from rigctl.analysis.search.identity import levels_of
from rigctl.analysis.search.rivals import nested_at
from rigctl.effects.equations import terms_in_symbols
from rigctl.effects.registry import find_effect
from rigctl.engine.least_squares import Unknown
from rigctl.engine.symbols import evaluate, variables_of

HYSTERESIS: Any = SimpleNamespace(name="hysteresis", becomes=(("distance", 0.0, "coulomb"),))


def fitted(distance: float, std: float, at_bound: bool) -> Any:
    unknowns = (
        Unknown("hysteresis.size", 2.0, 0.0, 10.0),
        Unknown("hysteresis.distance", 1e-3, 1e-7, 1.0),
    )
    return SimpleNamespace(
        problem=SimpleNamespace(shared=unknowns),
        values=np.array([2.0, distance]),
        std={"hysteresis.size": 0.1, "hysteresis.distance": std},
        at_bound=frozenset({"hysteresis.distance"} if at_bound else ()),
    )


@pytest.mark.parametrize(
    ("distance", "std", "at_bound", "nested"),
    [
        (2e-3, 1e-4, False, False),  # significantly different from 0
        (2e-3, 4e-3, False, True),  # within its uncertainty of 0
        (1e-7, 0.0, True, True),  # stopped by the bound on its way to 0
        (1.0, 0.0, True, False),  # the other bound is no limit
    ],
)
def test_a_law_within_its_uncertainty_of_the_limit_or_stopped_by_a_bound_towards_it_is_nested(
    distance: float, std: float, at_bound: bool, nested: bool
) -> None:
    found = nested_at(fitted(distance, std, at_bound), HYSTERESIS, "coulomb")
    assert found == ("distance 0" if nested else "")
    assert nested_at(fitted(distance, std, at_bound), HYSTERESIS, "stribeck") == ""


def test_a_parameter_at_its_bound_is_not_at_a_limit_inside_its_range() -> None:
    power: Any = SimpleNamespace(name="hysteresis", becomes=(("distance", 0.5, "leak"),))
    for bound in (1e-7, 1.0):
        assert nested_at(fitted(bound, 0.0, True), power, "leak") == ""


@pytest.mark.parametrize(
    ("static", "correlation", "nested"),
    [
        (150.0, 0.0, False),  # 70 N more at the start, known to 14 N
        (100.0, 0.0, True),  # 20 N, known to 14 N
        (100.0, 0.98, False),  # the same, but correlated: their difference is known to 2 N
        (80.0000001, 0.0, True),  # kept apart only by the constraint on their order
    ],
)
def test_stribeck_friction_whose_static_force_does_not_exceed_the_kinetic_is_coulomb_friction(
    static: float, correlation: float, nested: bool
) -> None:
    unknowns = (
        Unknown("stribeck_friction.force", 80.0, 0.0, 2e3),
        Unknown("stribeck_friction.static_force", 200.0, 0.0, 4e3),
    )
    off = 100.0 * correlation
    fit: Any = SimpleNamespace(
        problem=SimpleNamespace(shared=unknowns),
        values=np.array([80.0, static]),
        std={one.name: 10.0 for one in unknowns},
        at_bound=frozenset(),
        solution=SimpleNamespace(covariance=np.array([[100.0, off], [off, 100.0]])),
    )
    stribeck = find_effect("stribeck_friction", "hydraulic_cylinder")
    found = nested_at(fit, stribeck, "coulomb_friction")
    assert found == ("static_force equal to its force" if nested else "")


def test_a_law_with_two_parameters_equal_is_the_simpler_law() -> None:
    stribeck, coulomb = (
        find_effect(name, "hydraulic_cylinder") for name in ("stribeck_friction", "coulomb_friction")
    )
    (tied,) = simpler_laws(stribeck)
    assert [one.name for one in tied.parameters] == ["force", "stribeck_velocity", "presliding"]
    assert not list(simpler_laws(coulomb))
    values = {"velocity": 0.02, "force": 80.0, "stribeck_velocity": 0.01, "presliding": 5e-5, "bending": 0.4}
    family = stribeck.model_family
    plain, simpler = terms_in_symbols(coulomb, family), terms_in_symbols(tied, family)
    assert plain.keys() == simpler.keys()
    for slot in plain:
        at = [
            {one.name: values[one.name.rpartition(".")[2]] for one in variables_of(each[slot])}
            for each in (plain, simpler)
        ]
        assert evaluate(simpler[slot], at[1]) == pytest.approx(evaluate(plain[slot], at[0]), rel=1e-12)


def test_a_law_with_an_undetermined_parameter_is_not_claimed() -> None:
    effects = {"stribeck_friction": find_effect("stribeck_friction", "hydraulic_cylinder")}
    for spare in ((), ("stribeck_friction",)):
        (one,) = levels_of([["stribeck_friction"]], effects, sure=True, other_shape=False, spare=spare)
        assert (one.place_sure, one.driver_sure, one.law_sure) == (True, True, not spare)
