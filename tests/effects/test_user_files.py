"""Effect files: errors have their place, dimensions, nulls and slopes are checked, nothing is executed."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigctl.effects import Effect, qualified
from rigctl.effects.record_level import RECORD
from rigctl.effects.user import is_effect_file, load_effect, parse_effect
from rigctl.effects.user.load import place_of
from rigctl.engine.symbols import Graph, evaluate
from rigctl.errors import RigctlError, SeveralErrors
from rigctl.expressions import parse
from rigctl.expressions.functions import ALL_FUNCTIONS
from rigctl.files.shipped import shipped
from rigctl.model.reading_errors import CALIBRATION, CLOCK
from rigctl.physics.families import find_family
from rigctl.physics.scope import Scope

EXAMPLE = shipped("models", "effects", "piston-leakage-eccentric.yaml")
FAMILY = find_family("hydraulic_cylinder")


def written(
    term: str = "size*velocity/(1 m/s)",
    slot: str = "friction",
    parameters: str = "{size: {null_value: 0 N, start: 50 N, bounds: [0 N, 500 N]}}",
    more: str = "",
) -> str:
    return f"effect: mine\nsummary: A test.\nslot: {slot}\nterm: '{term}'\nparameters: {parameters}\n{more}"


def refused(text: str) -> str:
    with pytest.raises(RigctlError) as caught:
        parse_effect(text, Path("mine.yaml"))
    return str(caught.value)


def at(effect: Effect, slot: str, local: dict[str, float] | None = None, **changed: float) -> float:
    """The effect's share at a slot, in plain numbers."""
    known = {p.name: p.value for p in FAMILY.parameters} | {s.name: s.start for s in FAMILY.states}
    known |= {qualified(effect.name, name): value for name, value in effect.start.items()}
    scope = Scope(FAMILY, known | changed, additions=effect.additions())
    combine = scope.total if FAMILY.slot(slot).combine == "sum" else scope.factor
    return float(combine(slot, **(local or {})))


def test_the_shipped_example_equals_its_formula() -> None:
    effect = load_effect(EXAMPLE)
    assert effect.name == "piston_leakage_eccentric"
    assert effect.kind == "process"
    assert effect.null == {"conductance": 0.0, "eccentricity": 0.8}
    assert [p.sign for p in effect.parameters] == [1, 0]
    mu = 3.1083e-5 * math.exp(1132.5833 / (293.15 - 147.4466))
    expected = 5.2e-15 * (1 + 1.5 * 0.8**2) * (9e5 - 4e5) / mu
    assert at(effect, "flow_a_to_b", pressure_a=9e5, pressure_b=4e5) == pytest.approx(expected, rel=1e-6)


def test_a_difference_of_temperatures_in_degc_is_in_kelvin() -> None:
    effect = parse_effect(
        written(
            "1 + share*(oil_temperature - 20 degC)/(40 degC - 20 degC)",
            "throttle_area",
            "{share: {null_value: 0, start: 10 %, bounds: [-50 %, 50 %]}}",
        )
    )
    assert at(effect, "throttle_area", {"reynolds": 1e3}, oil_temperature=313.15) == pytest.approx(1.1)


def test_a_parameter_in_degc_is_a_temperature_and_one_in_kelvin_a_difference() -> None:
    effect = parse_effect(
        written(
            "size*smooth_step(oil_temperature - limit, width)",
            parameters="{size: {null_value: 0 N, start: 50 N, bounds: [0 N, 500 N]},"
            " limit: {start: 60 degC, bounds: [20 degC, 90 degC]},"
            " width: {start: 2 K, bounds: [0.5 K, 20 K]}}",
        )
    )
    assert effect.start == {"size": 50.0, "limit": 333.15, "width": 2.0}
    assert [p.difference for p in effect.parameters] == [True, False, True]
    expected = 50.0 * 0.5 * (1.0 + math.tanh(1.0))
    assert at(effect, "friction", velocity=0.1, oil_temperature=335.15) == pytest.approx(expected)


def test_the_variables_of_a_slot_are_known_only_there() -> None:
    effect = parse_effect(
        written(
            "delay*after^2", "valve_delay", "{delay: {null_value: 0 ms, start: 20 ms, bounds: [0 ms, 1 s]}}"
        )
    )
    assert at(effect, "valve_delay", {"before": 0.0, "after": -1.0}) == pytest.approx(0.02)
    assert "unknown name, got 'after'" in refused(written("size*after"))


def test_a_file_without_a_family_is_told_the_assumed_one() -> None:
    said = refused(written(slot="flow_reading"))
    assert "so it is of hydraulic_cylinder: 'family: FILE' says another" in said
    named = refused(written(slot="flow_reading", more="family: hydraulic_cylinder\n"))
    assert "unknown slot" in named
    assert "says another" not in named


def test_an_effect_may_act_at_several_slots() -> None:
    text = (
        "effect: weep\nsummary: Both sides weep.\n"
        "terms: {flow_a_to_tank: k*pressure_a/viscosity, flow_b_to_tank: k*pressure_b/viscosity}\n"
        "parameters: {k: {null_value: 0 m^3, start: 1e-15 m^3, bounds: [0 m^3, 1e-12 m^3]}}\n"
    )
    effect = parse_effect(text)
    assert effect.slots == ("flow_a_to_tank", "flow_b_to_tank")
    assert effect.equation == "flow_a_to_tank: k*pressure_a/viscosity; flow_b_to_tank: k*pressure_b/viscosity"


def test_the_kind_of_an_effect_follows_from_its_slot() -> None:
    share = "{gain: {null_value: 0, start: 1 %, bounds: [-10 %, 10 %]}}"
    assert parse_effect(written("gain*position", "position_reading", share)).kind == "sensor"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            written("size*velocty/(1 m/s)"),
            "mine.yaml:4:7: unknown name, got 'velocty'; did you mean 'velocity'?",
        ),
        (written("size*velocity"), "the term at friction is a power [m^2 kg s^-3]"),
        (written("size*velocity"), "expected a force [m kg s^-2], as every term there"),
        (written("size + pressure_a"), "cannot add"),
        (written(slot="frction"), "mine.yaml:3:7: unknown slot of hydraulic_cylinder"),
        (written(slot="frction"), "did you mean 'friction'?"),
        (written("size*exp(velocity)"), "cannot take exp of a speed"),
        (written("size*unknown(velocity)"), "unknown function"),
        (written("size*$oil"), "variables with a dollar belong to procedures"),
        (written("size*velocity.real"), "has no place in an expression"),
        (written("__import__(1)"), "unknown function"),
        (written("size*" + "(" * 40 + "1" + ")" * 40), "nested too deep"),
        (written("size+" * 400 + "size"), "too long"),
        (written("size*positive_part(velocity, 1 N)/(1 m/s)"), "the width of positive_part is a force"),
        (written("size*positive_part(velocity)/(1 m/s)"), "positive_part takes a value and a width"),
        (written("size*minimum(velocity, 1 m/s)/(1 m/s)"), "minimum takes two values and a width"),
    ],
)
def test_an_invalid_formula_is_refused_with_its_reason(text: str, message: str) -> None:
    assert message in refused(text)


@pytest.mark.parametrize(
    ("term", "instead"),
    [
        ("size*(velocity > 0 m/s)", "smooth_step(x - limit, width)"),
        ("size if velocity > 0 m/s else -size", "smooth_step(x - limit, width)"),
        ("if(velocity > 0 m/s, size, 0 N)", "smooth_step(x - limit, width)"),
        ("velocity > 0 m/s ? size : 0 N", "smooth_step(x - limit, width)"),
        ("size*(velocity > 0 m/s and position > 0 m)", "smooth_step(x - limit, width)"),
        ("not size", "smooth_step(x - limit, width)"),
        ("size*sign(velocity)", "smooth_sign(x, width), or tanh(x/width)"),
        ("size*abs(velocity)/(1 m/s)", "absolute(x, width)"),
        ("size*max(velocity, 0 m/s)/(1 m/s)", "positive_part(x, width)"),
        ("size*min(velocity, 1 m/s)/(1 m/s)", "minimum(a, b, width)"),
        ("size*Heaviside(velocity)", "smooth_step(x - limit, width)"),
    ],
)
def test_a_branch_or_a_corner_is_refused_with_the_smooth_alternative(term: str, instead: str) -> None:
    message = refused(written(term))
    assert message.startswith("mine.yaml:4:7: ")
    assert instead in message


@pytest.mark.parametrize(
    ("term", "slot", "message"),
    [
        (
            "size + 1 N",
            "friction",
            "size = 0 N, does not switch the term off: it is 1 there; expected exactly 0",
        ),
        ("size", "friction", None),
        ("1 + size/(1 N)", "throttle_area", None),
        ("size/(1 N)", "throttle_area", "it is 0 there; expected exactly 1"),
        (
            "size*sqrt(pressure_a/(1 bar))",
            "friction",
            "the term has no slope in pressure_a at pressure_a = 0",
        ),
        ("size*(1 m/s)/velocity", "friction", "the term has no value at velocity = 0"),
        ("size*(1 m/s)/absolute(velocity, 1 mm/s)", "friction", None),
        ("sqrt(size*1 N)", "friction", "the term has no slope in size at size = 0"),
        ("1 N*log(size/(1 N))", "friction", "the term has no value at size = 0"),
        ("size*size/size", "friction", "the term has no value at size = 0"),
        ("size*10^400", "friction", "a number in the term is out of range; expected below 1e308"),
        ("size*(oil_temperature/(1 K))^-200", "friction", None),
    ],
)
def test_a_term_must_be_exactly_off_at_null_and_smooth(term: str, slot: str, message: str | None) -> None:
    if message is None:
        assert parse_effect(written(term, slot)).slots == (slot,)
    else:
        assert message in refused(written(term, slot))


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        (
            "{size: {null_value: 0 N, start: 600 N, bounds: [0 N, 500 N]}}",
            "start is out of bounds, got '600 N'",
        ),
        (
            "{size: {null_value: -1 N, start: 6 N, bounds: [0 N, 500 N]}}",
            "null_value is out of bounds, got '-1 N'",
        ),
        ("{size: {null_value: 0 N, start: 6 N, bounds: [500 N, 0 N]}}", "the bounds leave no room"),
        ("{size: {null_value: 0 bar, start: 6 N, bounds: [0 N, 9 N]}}", "wrong dimension, got '0 bar'"),
        ("{size: {null_value: 0, start: 6 N, bounds: [0 N, 9 N]}}", "the unit is missing, got '0'"),
        ("{size: {null_value: 6 N, start: 6 N, bounds: [0 N, 9 N]}}", "the typical size is the null value"),
        ("{size: {start: 6 N, bounds: [0 N, 9 N]}}", "no parameter switches it off"),
        ("{size: {null_value: 0 N, start: 6 N, bounds: [0 N]}}", "too few entries"),
        ("{size: {nul_value: 0 N, start: 6 N, bounds: [0 N, 9 N]}}", "did you mean 'null_value'?"),
        ("{viscosity: {null_value: 0 N, start: 6 N, bounds: [0 N, 9 N]}}", "already means something"),
        ("{Size: {null_value: 0 N, start: 6 N, bounds: [0 N, 9 N]}}", "Size"),
        ("{}", "no parameter switches the effect off"),
        (
            "{size: {null_value: 0 N, start: 6 N, bounds: [0 N, 9 N]}, more: {start: 1, bounds: [0, 2]}}",
            "no term uses this parameter, got 'more'",
        ),
    ],
)
def test_invalid_parameter_declarations_are_refused(parameters: str, message: str) -> None:
    assert message in refused(written(parameters=parameters))


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ("confused_with: [piston_leek]\n", "did you mean 'piston_leakage'?"),
        ("instead_of: [nothing_like_it]\n", "unknown effect"),
        ("family: heater_bord\n", "did you mean 'heater_board'?"),
        ("terms: {friction: size}\n", "'terms' and 'slot' with 'term' say the same"),
        ("sources: x\n", "did you mean 'source'?"),
    ],
)
def test_additional_fields_of_a_file_are_checked(more: str, message: str) -> None:
    assert message in refused(written(more=more))


def test_a_name_of_the_library_is_refused() -> None:
    text = written().replace("effect: mine", "effect: coulomb_friction")
    assert "the library has an effect of this name" in refused(text)


@pytest.mark.parametrize("name", [RECORD, CALIBRATION, CLOCK])
def test_a_name_under_which_every_model_has_unknowns_is_refused(name: str) -> None:
    text = written().replace("effect: mine", f"effect: {name}")
    assert "this name stands for unknowns of every model" in refused(text)


def test_an_effect_that_adds_nothing_is_refused() -> None:
    text = "effect: mine\nsummary: s\nparameters: {a: {null_value: 0, start: 1, bounds: [0, 2]}}\n"
    assert "the effect adds nothing" in refused(text)
    assert "the field 'term' is missing" in refused(text + "slot: friction\n")
    assert "the field 'slot' is missing" in refused(text + "term: a*1 N\n")


def test_a_circular_term_is_refused() -> None:
    text = written(
        "1 + share*viscosity/(1 Pa*s)",
        "viscosity",
        "{share: {null_value: 0, start: 1 %, bounds: [0, 1]}}",
    )
    assert "an equation depends on itself" in refused(text)


def test_several_mistakes_are_reported_together_with_their_places() -> None:
    text = written(parameters="{size: {null_value: 0 N, start: 900 N, bounds: [0 N, 500 N]}}").replace(
        "effect: mine", "effect: barus"
    )
    with pytest.raises(SeveralErrors) as caught:
        parse_effect(text, Path("mine.yaml"))
    assert [error.where.line for error in caught.value.errors] == [1, 5]


def test_parts_of_a_file_are_located(tmp_path: Path) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text(written(), encoding="utf-8")
    assert place_of(file, ("terms", "friction")).line == 4
    assert place_of(file, ("parameters", "size")).line == 5
    assert is_effect_file(str(file))
    assert not is_effect_file("piston_leakage")


NAMES = {"velocity": 0.3, "size": 7.0, "position": 0.11, "spool": -0.4, "reynolds": 250.0}
_LEAVES = st.sampled_from(["spool", "position/(1 m)", "velocity/(1 m/s)", "2", "0.5", "3 mm/(1 m)"])


def _combined(inner: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    pair = st.tuples(inner, inner)
    return st.one_of(
        pair.map(lambda ab: f"({ab[0]} + {ab[1]})"),
        pair.map(lambda ab: f"({ab[0]} - {ab[1]})"),
        pair.map(lambda ab: f"({ab[0]})*({ab[1]})"),
        pair.map(lambda ab: f"({ab[0]})/(2 + ({ab[1]})^2)"),
        inner.map(lambda a: f"tanh({a})"),
        inner.map(lambda a: f"exp(tanh({a}))"),
        inner.map(lambda a: f"-({a})"),
        inner.map(lambda a: f"({a})^3"),
        inner.map(lambda a: f"sqrt(1 + ({a})^2)"),
        inner.map(lambda a: f"log(1.5 + tanh({a}))"),
        inner.map(lambda a: f"absolute({a}, 0.1)"),
        inner.map(lambda a: f"positive_part({a}, 0.1)"),
        pair.map(lambda ab: f"minimum({ab[0]}, {ab[1]}, 0.2)"),
        pair.map(lambda ab: f"maximum({ab[0]}, {ab[1]}, 0.2)"),
        inner.map(lambda a: f"smooth_sign({a}, 0.3)"),
        inner.map(lambda a: f"smooth_step({a}, 0.3)"),
    )


@given(st.recursive(_LEAVES, _combined, max_leaves=6))
def test_symbols_plain_numbers_and_the_grammar_agree(text: str) -> None:
    from rigctl.effects.declaration import EffectParameter, Own
    from rigctl.effects.user.formula import read_term
    from rigctl.units import parse_unit

    slot = FAMILY.slot("throttle_area")
    size = EffectParameter("size", "N", 0.0, 7.0, 0.0, 9.0, "")
    term = read_term(text, FAMILY, slot, [size])
    plain = Scope(FAMILY, NAMES)
    graph = Graph()
    units = {"velocity": "m/s", "position": "m", "spool": "1", "reynolds": "1"}
    variables = {name: graph.variable(name, parse_unit(unit).dimension) for name, unit in units.items()}
    symbolic = Scope(FAMILY, variables)
    expected = parse(text, functions=ALL_FUNCTIONS).evaluate(NAMES)
    assert term(plain, Own(plain, "mine")) == pytest.approx(expected, rel=1e-12, abs=1e-12)
    expr = graph.expression(term(symbolic, Own(symbolic, "mine")))
    assert evaluate(expr, NAMES) == pytest.approx(expected, rel=1e-12, abs=1e-12)


@given(st.text(alphabet="size*velocity/()+-^.,<>= 0123456789eEmNbar$?_xtanhsqrexp", max_size=60))
def test_any_text_is_read_or_refused_without_a_traceback(text: str) -> None:
    quoted = text.replace("'", "''")
    try:
        parse_effect(written(quoted))
    except RigctlError:
        return


def test_the_grid_of_values_for_a_threshold_is_read_and_checked() -> None:
    text = written(
        "size*positive_part(velocity - limit, 1 mm/s)/(1 m/s)",
        parameters="{size: {null_value: 0 N, start: 50 N, bounds: [0 N, 500 N]},"
        " limit: {start: 10 mm/s, bounds: [0 mm/s, 1 m/s], grid: [50 mm/s, 0.2 m/s]}}",
    )
    assert parse_effect(text).parameter("limit").grid == pytest.approx((0.05, 0.2))
    assert "mine.yaml:5:129: grid is out of bounds, got '2 m/s'" in refused(text.replace("0.2 m/s", "2 m/s"))
    held = written(
        parameters="{size: {null_value: 0 N, start: 50 N, bounds: [0 N, 500 N], grid: [0 N, 9 N]}}"
    )
    assert "the grid holds the null value" in refused(held)


def test_two_files_of_a_folder_may_name_each_other(tmp_path: Path) -> None:
    for name, other in (("mine", "other"), ("other", "mine")):
        text = written(more=f"confused_with: [{other}]\ninstead_of: [{other}]\n")
        (tmp_path / f"{name}.yaml").write_text(text.replace("mine", name, 1), encoding="utf-8")
    assert load_effect(tmp_path / "mine.yaml").confused_with == ("other",)
    (tmp_path / "other.yaml").unlink()
    with pytest.raises(RigctlError, match="unknown effect, got 'other'"):
        load_effect(tmp_path / "mine.yaml")
