"""Errors in a family are found before it is used."""

from __future__ import annotations

from dataclasses import replace

import pytest

from rigctl.errors import RigctlError
from rigctl.physics.families import FAMILIES
from rigctl.physics.family import (
    Definition,
    InputVariable,
    ModelFamily,
    OutputVariable,
    ParameterDeclaration,
    Slot,
    StateVariable,
)
from rigctl.physics.family_checks import check_family, examine_family, resting_points

CUP = ModelFamily(
    name="cup",
    title="A cup that cools",
    source="Newton (1701)",
    states=(StateVariable("heat", "K", 0.1, lambda m: m.cooling + m.total("warmth"), 333.15, ""),),
    inputs=(InputVariable("room", "K", 293.15, ""),),
    parameters=(ParameterDeclaration("time", "min", 600.0, "", 60.0, 7200.0),),
    definitions=(Definition("cooling", "K/s", lambda m: (m.room - m.heat) / m.time, ""),),
    slots=(Slot("warmth", "K/s", ""),),
    outputs=(OutputVariable("heat", "K", lambda m: m.heat, ""),),
)


@pytest.mark.parametrize("family", FAMILIES.values(), ids=lambda family: family.name)
def test_shipped_families_are_valid(family: ModelFamily) -> None:
    assert examine_family(family) == ()
    assert family.standard_record is not None
    assert family.standard_record.switches[0][0] == 0.0


def test_a_valid_family_is_returned() -> None:
    assert check_family(CUP) is CUP


def formula(text: str) -> ModelFamily:
    return replace(CUP, definitions=(Definition("cooling", "K/s", eval(f"lambda m: {text}"), ""),))


@pytest.mark.parametrize(
    ("family", "part", "said"),
    [
        (replace(CUP, outputs=()), "outputs", "the family has no outputs"),
        (
            replace(CUP, inputs=(InputVariable("heat", "K", 0.0, ""),)),
            "states",
            "this name is used twice, got 'heat'",
        ),
        (
            replace(CUP, states=(replace(CUP.states[0], unit="degC"),)),
            "states",
            "its unit is not SI, got 'degC'; expected K",
        ),
        (replace(CUP, slots=(Slot("warmth", "K/ss", ""),)), "slots", "unknown unit"),
        (replace(CUP, states=(replace(CUP.states[0], scale=0.0),)), "states", "the scale must be greater"),
        (
            replace(CUP, parameters=(replace(CUP.parameters[0], value=1.0),)),
            "parameters",
            "the value is out of bounds",
        ),
        (replace(CUP, rig_names={"tau": ("tme",)}), "parameters", "did you mean 'time'"),
        (formula("(m.room - m.heat)"), "definitions", "the equation of cooling has the dimension"),
        (formula("m.romm - m.heat"), "definitions", "did you mean 'room'"),
        (formula("m.cooling"), "definitions", "an equation depends on itself: cooling -> cooling"),
        (formula("1 / 0"), "definitions", "the equation fails: ZeroDivisionError"),
        (formula("m.heat if m.heat > 3.0 else m.room"), "definitions", "may not branch"),
        (formula("(m.heat - m.heat) / (m.heat - m.heat)"), "definitions", "divides by zero"),
        (replace(CUP, slots=(*CUP.slots, Slot("cold", "K/s", ""))), "slots", "no equation uses this"),
        (
            replace(CUP, parameters=(*CUP.parameters, replace(CUP.parameters[0], name="tme"))),
            "parameters",
            "no equation uses this, got 'tme'",
        ),
    ],
)
def test_errors_of_a_family_are_reported_with_their_part(family: ModelFamily, part: str, said: str) -> None:
    flaws = examine_family(family)
    assert flaws
    assert flaws[0].part == part
    assert said in str(flaws[0].error)
    with pytest.raises(RigctlError, match="the model family cup is not sound"):
        check_family(family)


def test_an_equation_without_a_derivative_is_located() -> None:
    def far(m):  # type: ignore[no-untyped-def]
        from rigctl.engine.symbols import sqrt

        return sqrt((m.heat - m.constant(333.15, "K")) / m.constant(1.0, "K")) * m.constant(1.0, "K/s")

    found = examine_family(replace(CUP, definitions=(*CUP.definitions, Definition("far", "K/s", far, ""))))
    assert [flaw.name for flaw in found] == ["far"]
    assert "far has no slope in heat at heat = 333.15 (SI)" in str(found[0].error)
    assert "absolute(x, width)" in str(found[0].error)


def test_inputs_and_constants_that_no_equation_uses_are_allowed() -> None:
    more = replace(
        CUP,
        inputs=(*CUP.inputs, InputVariable("stirrer", "1", 0.0, "")),
        parameters=(*CUP.parameters, ParameterDeclaration("depth", "mm", 0.1, "", fixed=True)),
    )
    assert examine_family(more) == ()


def test_equations_are_checked_at_and_near_rest() -> None:
    tried = sorted({point["heat"] for point in resting_points(CUP)})
    assert tried == pytest.approx([333.1, 333.15, 333.2])
