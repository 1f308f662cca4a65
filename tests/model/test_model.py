"""Model files: read with places, changed without side effects, turned into systems."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from rigctl.errors import RigctlError
from rigctl.families.hydraulic_cylinder.family import FAMILY as HYDRAULIC_CYLINDER
from rigctl.files.shipped import shipped
from rigctl.model import Model, input_sources, input_values, load_model, parse_model
from rigctl.rig.load import load_rig

TEXTBOOK = shipped("models", "hl32-textbook.yaml")
BENCH = shipped("rigs", "hl32-bench.yaml")


def model(text: str) -> Model:
    return parse_model("model: hydraulic_cylinder\n" + text, Path("m.yaml"))


def test_the_shipped_textbook_model_has_its_documented_contents() -> None:
    textbook = load_model(TEXTBOOK)
    assert textbook.family is HYDRAULIC_CYLINDER
    assert textbook.effects == {}
    assert textbook.fitted == (
        "flow_area",
        "viscous_damping",
        "moving_mass",
        "spool_time",
        "dead_volume_a",
        "dead_volume_b",
    )
    assert textbook.values["flow_area"] == pytest.approx(4.05e-6)
    assert textbook.values["edge_area"] == pytest.approx(28e-6)  # from the rig file
    assert textbook.name == "hl32-textbook"
    system = textbook.system()
    assert system.state_names == tuple(state.name for state in HYDRAULIC_CYLINDER.states)
    assert system.output_names == ("oil_temperature", "supply_pressure", "position")


def test_a_system_with_the_library_has_every_effect_at_its_null_value() -> None:
    system = load_model(TEXTBOOK).system(library=True)
    nominal = dict(zip(system.parameter_names, system.nominal, strict=True))
    assert nominal["piston_leakage.conductance"] == 0.0
    assert nominal["coulomb_friction.presliding"] == 20e-6


def test_values_of_the_rig_override_the_family_and_the_model_file_overrides_the_rig() -> None:
    rig = load_rig(BENCH)
    assert Model(HYDRAULIC_CYLINDER).values["tank_conductance"] == 12.0
    assert Model(HYDRAULIC_CYLINDER, rig).values["flow_area"] == pytest.approx(3.3e-6)
    assert model("parameters: {flow_area: 5 mm^2}\n").values["flow_area"] == pytest.approx(5e-6)


def test_effects_are_read_with_their_units() -> None:
    found = model(
        "effects:\n"
        "  coulomb_friction: {force: {value: 80 N, fit: true}}\n"
        "  piston_leakage: {clearance: 30 um}\n"
    )
    assert found.values["coulomb_friction.force"] == 80.0
    assert found.values["coulomb_friction.presliding"] == 20e-6  # its typical size
    assert found.values["piston_leakage.conductance"] == pytest.approx(1.767e-14, rel=1e-3)
    assert found.fitted == ("coulomb_friction.force",)
    assert "piston_leakage.conductance" in found.system().parameter_names


@pytest.mark.parametrize(
    ("text", "place", "message"),
    [
        ("parameters: {flow_araea: 4 mm^2}", "m.yaml:2:14", "did you mean 'flow_area'"),
        ("parameters: {flow_area: 4 mm}", "m.yaml:2:25", "wrong dimension"),
        ("parameters: {flow_area: {value: 4}}", "m.yaml:2:33", "unit is missing"),
        ("parameters: {flow_area: 4 m^2}", "m.yaml:2:25", "flow_area is out of bounds"),
        ("parameters: {flow_area: {valu: 4 mm^2}}", "m.yaml:2:26", "did you mean 'value'"),
        ("parameters: {bore: {value: 50 mm, fit: true}}", "m.yaml:2:40", "no fit changes"),
        ("effects: {piston_leak: {}}", "m.yaml:2:11", "did you mean 'piston_leakage'"),
        ("effects: {spool_lag: {}}", "m.yaml:2:11", "base physics"),
        ("effects: {coulomb_friction: {force: 3 bar}}", "m.yaml:2:37", "wrong dimension"),
        ("effects: {coulomb_friction: {forse: 3 N}}", "m.yaml:2:37", "did you mean 'force'"),
        ("oil: HL23", "m.yaml:2:6", "did you mean 'HL32'"),
        ("rig: rigs/no-such.yaml", "m.yaml:2:6", "no such file"),
        ("efects: {}", "m.yaml:2:1", "did you mean 'effects'"),
    ],
)
def test_mistakes_are_reported_with_line_and_column(text: str, place: str, message: str) -> None:
    with pytest.raises(RigctlError, match=message) as caught:
        model(text + "\n")
    assert str(caught.value).startswith(place)


def test_an_unknown_family_is_refused_with_the_nearest_name() -> None:
    with pytest.raises(RigctlError, match="did you mean 'hydraulic_cylinder'"):
        parse_model("model: hydraulic_cilinder\n")


def test_all_mistakes_of_a_file_are_reported_together() -> None:
    with pytest.raises(RigctlError) as caught:
        model("parameters: {flow_araea: 4 mm^2, moving_mass: 3 m}\n")
    assert str(caught.value).count("m.yaml:2:") == 2


def test_adding_and_removing_an_effect_leaves_the_original_model_unchanged() -> None:
    textbook = load_model(TEXTBOOK)
    more = textbook.with_effect("coulomb_friction", {"force": 55.0})
    assert textbook.effects == {}
    assert more.values["coulomb_friction.force"] == 55.0
    assert more.fitted[-1] == "coulomb_friction.force"
    assert more.without_effect("coulomb_friction").values == textbook.values
    with pytest.raises(RigctlError, match="already"):
        more.with_effect("coulomb_friction", {})
    with pytest.raises(RigctlError, match="unknown effect of this model"):
        textbook.without_effect("coulomb_friction")


def test_base_physics_can_be_removed_and_restored() -> None:
    textbook = load_model(TEXTBOOK)
    without = textbook.without_effect("spool_lag")
    assert without.values["spool_time"] == 1e-3
    assert "spool_time" not in without.fitted
    assert without.with_effect("spool_lag", {}).values["spool_time"] == pytest.approx(25e-3)


def test_changing_values_by_name_keeps_the_free_parameters() -> None:
    more = load_model(TEXTBOOK).with_effect("coulomb_friction", {})
    changed = more.with_values({"flow_area": 3e-6, "coulomb_friction.force": 7.0, "edge_area": 2e-5})
    assert changed.fitted == more.fitted
    assert changed.values["coulomb_friction.force"] == 7.0
    assert changed.values["edge_area"] == 2e-5
    with pytest.raises(RigctlError, match="did you mean 'flow_area'"):
        more.with_values({"flow_are": 1.0})


def test_inputs_follow_from_the_roles_of_the_rig() -> None:
    rig = load_rig(BENCH)
    sources = input_sources("hydraulic_cylinder", rig, {"pump": 0.0})
    commands = {"valve": -1.0, "heater": 1.0, "relief_valve": 30e5}
    values = dict(zip([s.input for s in sources], input_values(sources, commands), strict=True))
    assert values["valve"] == -1.0
    assert values["heater_power"] == 2000.0
    assert values["pressure_setpoint"] == 30e5
    assert values["ambient_temperature"] == pytest.approx(295.15)
    assert values["pump"] == 0.0


def test_the_schema_accepts_a_plain_value_or_a_value_with_its_fields() -> None:
    from rigctl.model.schema import ModelFile

    schema = ModelFile.model_json_schema()
    branches = schema["$defs"]["Setting"]["anyOf"]
    assert branches[0]["examples"]
    assert set(branches[1]["properties"]) == {"value", "fit", "std", "prior", "standing", "range", "from"}


def test_base_physics_that_a_model_has_is_not_added_again() -> None:
    """`rigctl model add M linear_friction` used to reset the fitted damping to the value of the family."""
    own = load_model(TEXTBOOK).with_values({"viscous_damping": 150.0})
    with pytest.raises(RigctlError, match="has this effect already"):
        own.with_effect("linear_friction", {})
    without = own.without_effect("linear_friction")
    assert without.values["viscous_damping"] == 0.0
    assert without.with_effect("linear_friction", {}).values["viscous_damping"] > 0.0


def test_two_families_of_one_name_are_two_benches() -> None:
    """Inputs are passed by their order: those read for one family would drive another wrongly."""
    path = shipped("models", "hl32-textbook.yaml")
    model, again = load_model(path), load_model(path)
    assert model.same_bench(again)
    turned = replace(model.family, inputs=model.family.inputs[::-1])
    assert not model.same_bench(replace(again, family=turned))
    assert not model.same_bench(replace(again, rig=None))
