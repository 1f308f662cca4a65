"""Terms written in the grammar and read again have the same values."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rigctl.effects import Effect, qualified
from rigctl.effects.equations import terms_in_symbols
from rigctl.effects.registry import library
from rigctl.effects.user import parse_effect
from rigctl.effects.user.file_text import effect_file_text
from rigctl.effects.user.formula import read_term
from rigctl.effects.user.formula_text import formula_text
from rigctl.effects.user.names import term_types
from rigctl.engine.symbols import evaluate, variables_of
from rigctl.physics.families import FAMILIES

#: effects that a file can express: those without states of their own
EFFECTS = [
    effect
    for family in FAMILIES.values()
    for effect in library(family).values()
    if effect.terms and not effect.states
]


def texts(effect: Effect) -> dict[str, str]:
    family = effect.model_family
    names = {qualified(effect.name, one.name): one.name for one in effect.parameters}
    found = {}
    for slot, expr in terms_in_symbols(effect, family).items():
        types = term_types(family, family.slot(slot), effect.parameters)
        points = {name for name, one in types.items() if one.temperature == "point"}
        points |= {name for name, plain in names.items() if plain in points}
        found[slot] = formula_text(expr, names, points)
    return found


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda one: f"{one.family}-{one.name}")
def test_a_term_written_as_text_is_read_back_with_equal_values(effect: Effect) -> None:
    family, rng = effect.model_family, np.random.default_rng(1)
    before = terms_in_symbols(effect, family)
    for slot, text in texts(effect).items():
        read = read_term(text, family, family.slot(slot), effect.parameters)
        after = terms_in_symbols(replace(effect, terms=((slot, read),)), family)[slot]
        names = {one.name for one in (*variables_of(before[slot]), *variables_of(after))}
        for _ in range(3):
            values = {name: float(rng.uniform(0.5, 1.5)) for name in sorted(names)}
            # kinematic viscosity may be written as a name or as a quotient: the values must agree
            values |= {"true_dynamic_viscosity": 0.7, "true_density": 1.4, "true_kinematic_viscosity": 0.5}
            expected = evaluate(before[slot], values)
            assert evaluate(after, values) == pytest.approx(expected, rel=1e-9, nan_ok=True)


def test_an_effect_of_the_library_can_be_written_to_a_file_and_read_back() -> None:
    effect = library("hydraulic_cylinder")["piston_leakage"]
    read = parse_effect(effect_file_text(effect, texts(effect), effect.family, "leak"))
    assert read.name == "leak"
    for old, new in zip(effect.parameters, read.parameters, strict=True):
        assert (new.name, new.unit, new.null, new.meaning) == (old.name, old.unit, old.null, old.meaning)
        assert (new.start, new.low, new.high) == pytest.approx((old.start, old.low, old.high))
        assert new.usual == old.usual
