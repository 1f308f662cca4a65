"""A written model file reads as the changed model, and keeps its comments and all unchanged text."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigctl.errors import RigctlError
from rigctl.files.layout import Text
from rigctl.files.shipped import shipped
from rigctl.model import Model, load_model, parse_model
from rigctl.model.writing.numbers import std_text, value_text
from rigctl.model.writing.update import updated_text

PATH = Path("m.yaml")

#: one model in the layouts that users write
LAYOUTS = {
    "as shipped": (
        "# top\n\nmodel: heater_board   # the family\nparameters:\n"
        "  # before the gain\n"
        "  heater_gain_1: {value: 1 W, fit: true}          # gain\n"
        "  convection: {value: 12 mW/K, fit: true, std: 0.1 mW/K, from: a data sheet}   # loss\n"
        "  heat_capacity: 2 J/K  # weighed\n\n# besides its base\neffects: {}  # none\n# end\n"
    ),
    "in blocks": (
        "model: heater_board\nparameters:\n    heater_gain_1:   # gain\n        value: 1 W   # one\n"
        "        fit: true\n    # in between\n"
        "    convection:\n        fit: true  # free\n        value: 12 mW/K\n"
        "    heat_capacity: 2 J/K\neffects:\n    radiation:  # to the room\n        area: 9 cm^2\n# end"
    ),
    "in one line": (
        "{model: heater_board, parameters: {heater_gain_1: 1 W, heat_capacity: 2.0 J/K,"
        " convection: {value: 0.012 W/K, fit: true}},"
        " effects: {radiation: {area: {value: 9 cm^2, fit: true}}}}\n"
    ),
    "quoted": (
        "model: heater_board\nparameters:\n  'convection': \"12 mW/K\"   # loss\n"
        "  heater_gain_1: {'value': '1 W',\n                  fit: true}   # over two lines\n"
    ),
    "nothing said": "model: heater_board\n",
    "empty": "model: heater_board   # only\nparameters:\neffects:   # yet\n  radiation:  # all typical\n",
    "null": "model: heater_board\nparameters: ~\neffects: null",
}


def comments(text: str) -> list[str]:
    return re.findall(r"#[^\n]*", text)


def same(one: Model, other: Model) -> None:
    assert set(one.effects) == set(other.effects)
    assert set(one.fitted) == set(other.fitted)
    assert dict(one.values) == pytest.approx(dict(other.values), rel=1e-5)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_an_unchanged_model_is_written_unchanged(layout: str) -> None:
    text = LAYOUTS[layout]
    assert updated_text(parse_model(text, PATH), PATH) == text


@pytest.mark.parametrize("path", sorted(shipped("models").glob("*.yaml")), ids=lambda path: path.stem)
@pytest.mark.parametrize("newline", ["\n", "\r\n"])
def test_changing_every_parameter_of_a_shipped_model_keeps_its_comments(path: Path, newline: str) -> None:
    text = path.read_text(encoding="utf-8").replace("\n", newline)
    model = parse_model(text, path)
    changed = model.with_values(
        {name: 1.01 * value.si for name, value in model.parameters.items()},
        std={name: 0.01 * value.si for name, value in model.parameters.items()},
        source="fitted 2026-11-21 to 3 runs",
    )
    written = updated_text(changed, path)
    assert comments(written) == comments(text)
    assert written.count("\n") == text.count("\n") == written.count(newline)
    again = parse_model(written, path)
    same(again, changed)
    for name, value in again.parameters.items():
        assert value.std == pytest.approx(0.01 * model.parameters[name].si, rel=0.05)
        assert value.source == "fitted 2026-11-21 to 3 runs"
        assert value.unit == model.parameters[name].unit


_CHANGES = st.lists(
    st.one_of(
        st.tuples(
            st.sampled_from(("convection", "heater_gain_1", "heat_capacity", "radiation.area")),
            st.floats(0.11, 0.49),
            st.one_of(st.none(), st.floats(1e-9, 1e-2)),
            st.sampled_from(("", "a fit", "fitted: 3 runs", 'it\'s "x"', "true", "7")),
        ),
        st.sampled_from(("add radiation", "remove radiation", "add power_law_convection")),
    ),
    max_size=6,
)


@settings(max_examples=80)
@given(st.sampled_from(sorted(LAYOUTS)), _CHANGES)
def test_any_sequence_of_changes_survives_writing_in_any_layout(
    layout: str, changes: list[tuple[str, float, float | None, str] | str]
) -> None:
    """Each change is written and read again; the comments of unchanged parts remain."""
    text = LAYOUTS[layout]
    model = parse_model(text, PATH)
    for change in changes:
        if isinstance(change, str):
            verb, name = change.split()
            if (verb == "add") == (name in model.effects):
                continue
            model = model.with_effect(name, {}) if verb == "add" else model.without_effect(name)
        else:
            name, value, std, source = change
            if name not in model.values:
                continue
            known = {} if std is None else {name: std}
            model = model.with_values(
                {name: value if "." not in name else value / 100.0}, std=known, source=source
            )
        written = updated_text(model, PATH)
        again = parse_model(written, PATH)
        same(again, model)
        gone = {"# to the room", "# all typical"} if "radiation" not in model.effects else set()
        told = comments(model.text)
        assert [c for c in comments(written) if c in told] == [
            c for c in told if c not in gone or c in written
        ]
        for name, setting in model.parameters.items():
            found = again.parameters[name]
            assert found.source == setting.source
            assert (found.std is None) == (setting.std is None)
        model = again


def test_an_unchanged_value_keeps_its_text() -> None:
    text = (
        "model: heater_board\nparameters:\n  heater_gain_1: {value: 1.000 W, fit: true}\n"
        "  convection: 12.0 mW/K\n"
    )
    model = parse_model(text, PATH).with_values(
        {"convection": 0.0125}, std={"convection": 1e-4}, source="a fit"
    )
    assert updated_text(model, PATH) == text.replace(
        "12.0 mW/K", "{value: 12.5 mW/K, std: 0.1 mW/K, from: a fit}"
    )


def test_a_changed_value_loses_its_former_uncertainty_and_source() -> None:
    model = parse_model(LAYOUTS["as shipped"], PATH).with_values({"convection": 0.0125})
    assert "  convection: {value: 12.5 mW/K, fit: true}  # loss\n" in updated_text(model, PATH)


def test_a_comment_keeps_its_column_if_the_value_fits() -> None:
    text = "model: heater_board\nparameters:\n  convection: {value: 12 mW/K, fit: true}      # loss\n"
    model = parse_model(text, PATH)
    assert "{value: 12.3457 mW/K" not in text
    column = [line.index("#") for line in text.splitlines() if "#" in line]
    written = updated_text(model.with_values({"convection": 0.0123}), PATH)
    assert [line.index("#") for line in written.splitlines() if "#" in line] == column
    longer = updated_text(model.with_values({"convection": 0.0123}, source="a very long story"), PATH)
    assert "}  # loss\n" in longer


def test_adding_and_removing_an_effect_restores_the_file() -> None:
    text = shipped("models", "hl32-textbook.yaml").read_text(encoding="utf-8")
    path = shipped("models", "hl32-textbook.yaml")
    more = parse_model(updated_text(load_model(path).with_effect("coulomb_friction", {}), path), path)
    force, presliding = (p.start for p in more.effect("coulomb_friction").parameters)
    added = f"effects:\n  coulomb_friction:\n    force: {{value: {force:g} N, fit: true}}\n"
    assert f"{added}    presliding: {1e3 * presliding:g} mm\n" in more.text
    assert updated_text(more.without_effect("coulomb_friction"), path) == text


def test_removing_an_effect_keeps_the_comments_around_it() -> None:
    text = (
        "model: heater_board\neffects:\n  radiation: {area: 9 cm^2}  # old\n  # the thermometers are late\n"
        "  sensor_lag: {}\n  # last words\n"
    )
    written = updated_text(parse_model(text, PATH).without_effect("radiation"), PATH)
    assert (
        written
        == "model: heater_board\neffects:\n  # the thermometers are late\n  sensor_lag: {}\n  # last words\n"
    )


def test_a_fitted_gap_is_written_as_its_conductance() -> None:
    text = (
        "model: hydraulic_cylinder\neffects:\n"
        "  piston_leakage: {clearance: {value: 30 um, fit: true, std: 1 um}}\n"
    )
    model = parse_model(text, PATH)
    given_std = model.effects["piston_leakage"]["conductance"].std
    assert given_std == pytest.approx(model.values["piston_leakage.conductance"] / 10.0, rel=1e-2)  # k ~ h^3
    assert updated_text(model, PATH) == text
    fitted = model.with_values(
        {"piston_leakage.conductance": 1.5e-14}, std={"piston_leakage.conductance": 2e-16}
    )
    assert "{conductance: {value: 1.5e-14 m^3, fit: true, std: 2e-16 m^3}}" in updated_text(fitted, PATH)


def test_lists_of_files_are_extended_in_their_own_style() -> None:
    for text, grown in (
        ("a: 1\n", "a: 1\nfiles: [x.yaml]\n"),
        ("files: []\n", "files: [x.yaml]\n"),
        ("files: [b.yaml]  # c\n", "files: [b.yaml, x.yaml]  # c\n"),
        ("files:\n  - b.yaml  # c\na: 1\n", "files:\n  - b.yaml  # c\n  - x.yaml\na: 1\n"),
    ):
        edited = Text(text)
        edited.append("files", "x.yaml")
        assert edited.text == grown


def test_a_file_with_anchors_is_refused_with_the_place() -> None:
    text = "model: heater_board\nparameters:\n  heater_gain_1: &w 1 W\n  heater_gain_2: *w\n"
    with pytest.raises(RigctlError, match="anchors") as refused:
        updated_text(parse_model(text, PATH).with_values({"heater_gain_1": 2.0}), PATH)
    assert (refused.value.where.line, refused.value.where.column) == (4, 18)


@pytest.mark.parametrize(
    ("value", "unit", "std", "text"),
    [
        (3.3012345678e-6, "mm^2", None, "3.301234568 mm^2"),
        (3.3012345678e-6, "mm^2", 3.1e-9, "3.30123 mm^2"),
        (3.3012345678e-6, "mm^2", 3.1e-13, "3.301234568 mm^2"),
        (3.3e-6, "mm^2", 1e-6, "3.3 mm^2"),
        (313.15, "degC", 0.5, "40 degC"),
        (0.62, "1", None, "0.62"),
        (0.0, "N", 3.0, "0 N"),
        (1e-6, "l/min", None, "0.06 l/min"),
    ],
)
def test_the_digits_of_a_value_follow_its_uncertainty(
    value: float, unit: str, std: float | None, text: str
) -> None:
    assert value_text(value, unit, std=std) == text


def test_an_uncertainty_has_two_digits_and_that_of_a_temperature_is_in_kelvin() -> None:
    assert std_text(0.123456e-6, "mm^2") == "0.12 mm^2"
    assert std_text(0.5, "degC") == "0.5 K"
    assert std_text(0.0123, "1") == "0.012"


@given(st.floats(1e-6, 1e-2), st.floats(1e-12, 1e-3))
def test_a_written_value_lies_within_the_bounds_and_near_the_true_one(value: float, std: float) -> None:
    text = value_text(value, "l/min", std=std, low=1e-6, high=1e-2)
    model = parse_model(f"model: hydraulic_cylinder\nparameters: {{pump_flow: {text}}}\n")
    assert model.values["pump_flow"] == pytest.approx(value, rel=1e-5, abs=std / 50.0)


def test_a_value_that_is_not_finite_is_refused() -> None:
    model = parse_model(LAYOUTS["as shipped"], PATH).with_values({"convection": float("nan")})
    with pytest.raises(RigctlError, match="not a finite number"):
        updated_text(model, PATH)


@pytest.mark.parametrize(
    ("text", "place", "message"),
    [
        ("parameters: {convection: {value: 12 mW/K, std: 1 mW}}", "m.yaml:2:48", "wrong dimension"),
        ("parameters: {convection: {value: 12 mW/K, std: -1 mW/K}}", "m.yaml:2:48", "not negative"),
        ("parameters: {convection: {value: 12 mW/K, form: x}}", "m.yaml:2:43", "did you mean 'from'"),
        ("effects: {radiation: {area: {value: 9 cm^2, std: 1}}}", "m.yaml:2:50", "unit is missing"),
    ],
)
def test_a_wrong_uncertainty_is_reported_with_its_place(text: str, place: str, message: str) -> None:
    with pytest.raises(RigctlError, match=message) as refused:
        parse_model("model: heater_board\n" + text, PATH)
    assert str(refused.value.where) == place


def test_a_source_may_contain_any_characters() -> None:
    said = 'fit: {3} runs # and [more], it\'s "x"\\ é ±'
    model = parse_model(LAYOUTS["as shipped"], PATH).with_values({"convection": 0.02}, source=said)
    assert parse_model(updated_text(model, PATH), PATH).parameters["convection"].source == said
