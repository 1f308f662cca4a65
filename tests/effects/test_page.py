"""The reference pages of the library: complete, current, and with sound LaTeX equations."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from rigctl.effects import Effect, library
from rigctl.effects.declaration import EffectParameter
from rigctl.effects.document import effect_document, family_document
from rigctl.effects.equations import latex_of, terms_in_symbols, text_of
from rigctl.effects.user import load_effect
from rigctl.engine.symbols import tanh
from rigctl.files.shipped import shipped
from rigctl.physics.families import FAMILIES, find_family

DOCS = Path(__file__).resolve().parents[2] / "docs" / "reference" / "effects"
EVERY = [effect for family in FAMILIES for effect in library(family).values()]


def test_the_page_of_generic_effects_has_each_kind() -> None:
    page = (DOCS / "generic.md").read_text(encoding="utf-8")
    for name in ("coulomb_on_speed", "threshold_on_store", "dead_time_of_command", "lag_of_reading"):
        assert f"### {name}\n" in page


@pytest.mark.parametrize("family", FAMILIES)
def test_the_page_has_every_effect_slot_and_variable(family: str) -> None:
    page = (DOCS / f"{family}.md").read_text(encoding="utf-8")
    for effect in library(family).values():
        assert f"# {effect.name}\n" in page
    document = family_document(find_family(family))
    for item in (*document["slots"], *document["variables"]):
        assert f"| `{item['name']}` |" in page


@pytest.mark.parametrize("effect", EVERY, ids=lambda effect: f"{effect.family}-{effect.name}")
def test_every_latex_equation_is_balanced_and_has_no_qualified_names(effect: Effect) -> None:
    family = find_family(effect.family)
    for term in terms_in_symbols(effect, family).values():
        latex = latex_of(term, effect)
        assert latex.count("{") == latex.count("}")
        assert latex.count(r"\left(") == latex.count(r"\right)")
        assert "." not in re.sub(r"\d\.\d", "", latex)  # no qualified name is left


def test_the_viscosity_of_a_leakage_gap_is_written_as_viscosity() -> None:
    effect = library("hydraulic_cylinder")["piston_leakage"]
    term = terms_in_symbols(effect, find_family(effect.family))["flow_a_to_b"]
    assert latex_of(term, effect) == r"\frac{\mathrm{conductance} \, \left(p_A - p_B\right)}{\mu}"
    assert text_of(term, effect, find_family(effect.family)) == (
        "conductance*(pressure_a - pressure_b)/viscosity"
    )


def test_a_parameter_with_the_name_of_a_variable_keeps_its_qualified_name() -> None:
    effect = Effect(
        name="drag",
        family="hydraulic_cylinder",
        summary="Drag.",
        equation="F = F_c·tanh(v/v_s)",
        source="none",
        terms=(("friction", lambda m, p: p.force * tanh(m.velocity / p.velocity)),),
        parameters=(
            EffectParameter("force", "N", 0.0, 100.0, 0.0, 2e3, "F_c"),
            EffectParameter("velocity", "mm/s", None, 2e-3, 1e-4, 50e-3, "v_s"),
        ),
        looks_like="Drag.",
    )
    term = terms_in_symbols(effect, find_family(effect.family))["friction"]
    assert "tanh(velocity/drag.velocity)" in text_of(term, effect, find_family(effect.family))


def test_the_json_of_an_effect_has_values_in_its_own_units() -> None:
    document = effect_document(library("hydraulic_cylinder")["position_offset"])
    assert document["parameters"] == [
        {
            "name": "offset",
            "unit": "mm",
            "null": 0.0,
            "start": 1.0,
            "low": -50.0,
            "high": 50.0,
            "sign": 0,
            "physical": {"low": False, "high": False},
            "at_least": None,
            "shape": False,
            "meaning": "c",
        }
    ]
    own = effect_document(load_effect(shipped("models", "effects", "piston-leakage-eccentric.yaml")))
    assert own["instead_of"] == ["piston_leakage"]
    assert own["parameters"][1]["null"] is None
