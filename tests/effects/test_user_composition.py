"""Several effects at once: their order does not matter, contradictions are refused, files are included."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigctl.effects import Effect, library
from rigctl.effects.contradiction import refuse_contradictions
from rigctl.effects.option import read_effect_option
from rigctl.effects.user import load_effect, parse_effect
from rigctl.engine.symbols import evaluate, to_text
from rigctl.errors import RigctlError
from rigctl.files.shipped import shipped
from rigctl.model import Model, build_system, load_model, parse_model
from rigctl.physics.families import find_family

FAMILY = find_family("hydraulic_cylinder")
EXAMPLE = shipped("models", "effects", "piston-leakage-eccentric.yaml")
OWN = (
    load_effect(EXAMPLE),
    parse_effect(
        "effect: drag\nsummary: Drag.\nslot: friction\nterm: size*velocity/(1 m/s)\n"
        "parameters: {size: {null_value: 0 N, start: 50 N, bounds: [0 N, 500 N]}}\n"
    ),
    parse_effect(
        "effect: swelling\nsummary: The throttle swells.\nslot: throttle_area\n"
        "term: 1 + size*(oil_temperature - 20 degC)/(1 K)\n"
        "parameters: {size: {null_value: 0, start: -1e-3, bounds: [-0.01, 0.01]}}\n"
    ),
)
LIBRARY = [effect for effect in library(FAMILY.name).values() if effect.terms]


@st.composite
def shuffled(draw: st.DrawFn) -> tuple[list[Effect], list[Effect]]:
    """Some effects, and the same in another order."""
    chosen = draw(
        st.lists(st.sampled_from([*LIBRARY, *OWN]), min_size=2, max_size=6, unique_by=lambda e: e.name)
    )
    return chosen, draw(st.permutations(chosen))


@given(shuffled())
def test_the_system_does_not_depend_on_the_order_of_effects(
    orders: tuple[list[Effect], list[Effect]],
) -> None:
    first, second = (
        build_system(FAMILY, {effect.name: effect.start for effect in order}, own_effects=OWN)
        for order in orders
    )
    assert first.state_names == second.state_names
    assert first.parameter_names == second.parameter_names
    assert first.nominal == second.nominal
    # equal text gives equal machine code, so not even the rounding differs
    assert [to_text(rate) for rate in first.rhs] == [to_text(rate) for rate in second.rhs]
    assert [to_text(output.expr) for output in first.outputs] == [
        to_text(output.expr) for output in second.outputs
    ]


def test_contributions_to_one_slot_add() -> None:
    values = dict.fromkeys(("spool", "valve", "pump", "heater_power"), 1.0)
    values |= {"supply_pressure": 30e5, "pressure_a": 12e5, "pressure_b": 5e5, "position": 0.1}
    values |= {"oil_temperature": 320.0, "velocity": 0.1, "pressure_setpoint": 30e5}
    values |= {"ambient_temperature": 295.0, "coulomb_friction.bending": 1.0}

    def acceleration(*names: str) -> float:
        effects = {effect.name: effect.start for effect in (*LIBRARY, *OWN) if effect.name in names}
        system = build_system(FAMILY, effects, own_effects=OWN)
        known = values | dict(zip(system.parameter_names, system.nominal, strict=True))
        return evaluate(system.rhs[system.state_names.index("velocity")], known)

    base = acceleration()
    shares = [acceleration(name) - base for name in ("drag", "coulomb_friction", "viscous_friction")]
    together = acceleration("drag", "coulomb_friction", "viscous_friction")
    assert together - base == pytest.approx(sum(shares), rel=1e-9)
    assert shares[0] == pytest.approx(-50.0 * 0.1 / 12.0)


def test_contradictory_effects_are_refused() -> None:
    eccentric, plain = OWN[0], library(FAMILY.name)["piston_leakage"]
    for pair in ([eccentric, plain], [plain, eccentric]):
        with pytest.raises(RigctlError, match="contradict one another"):
            refuse_contradictions(pair)
    refuse_contradictions([eccentric, OWN[1], library(FAMILY.name)["barus"]])
    with pytest.raises(RigctlError, match="barus and modulus_viscosity contradict"):
        Model(FAMILY).with_effect("barus", {}).with_effect("modulus_viscosity", {})


def test_the_option_accepts_an_effect_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mine = tmp_path / "my effect.yaml"
    mine.write_text(EXAMPLE.read_text(encoding="utf-8"), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    for text in (
        f"{mine}:conductance=2e-14 m^3, eccentricity=0.5",
        "my effect.yaml : conductance=2e-14 m^3, eccentricity=0.5",
    ):
        effect, values = read_effect_option(text)
        assert effect.name == "piston_leakage_eccentric"
        assert values == {"conductance": 2e-14, "eccentricity": 0.5}
    assert read_effect_option(str(mine))[1] == effect.start
    # a shipped one is found without its folder
    assert read_effect_option("models/effects/piston-leakage-eccentric.yaml")[0].name == effect.name


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("nowhere.yaml", "nowhere.yaml"),
        ("mine.yaml:conductence=2 m^3", "did you mean 'conductance'"),
        ("mine.yaml:conductance=2 m^2", "wrong dimension"),
        ("mine.yaml:conductance=1 m^3", "out of bounds"),
    ],
)
def test_mistakes_in_the_option_of_a_file_are_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str, message: str
) -> None:
    (tmp_path / "mine.yaml").write_text(EXAMPLE.read_text(encoding="utf-8"), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(RigctlError, match=message):
        read_effect_option(text)


def test_an_effect_of_another_family_is_refused() -> None:
    with pytest.raises(RigctlError, match="another family"):
        read_effect_option(str(EXAMPLE), find_family("heater_board"))


def test_a_user_effect_is_added_to_and_removed_from_a_model() -> None:
    own = OWN[0]
    model = Model(FAMILY).with_effect(own, {"conductance": 1e-14})
    assert model.values["piston_leakage_eccentric.conductance"] == 1e-14
    assert model.fitted == ("piston_leakage_eccentric.conductance",)
    assert "piston_leakage_eccentric.eccentricity" in model.system().parameter_names
    assert "barus.coefficient" in model.system(library=True).parameter_names
    assert model.without_effect("piston_leakage_eccentric").effects == {}
    with pytest.raises(RigctlError, match="has this effect already"):
        model.with_effect(own, {})
    with pytest.raises(RigctlError, match="contradict one another"):
        model.with_effect("piston_leakage", {})


MODEL = """\
model: hydraulic_cylinder
own_effects: [{file}]
effects: {{piston_leakage_eccentric: {{conductance: {{value: 1e-14 m^3, fit: true}}}}}}
"""


def test_a_model_file_may_name_effect_files_beside_it(tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text(EXAMPLE.read_text(encoding="utf-8"), encoding="utf-8")
    file = tmp_path / "model.yaml"
    file.write_text(MODEL.format(file="mine.yaml"), encoding="utf-8")
    model = load_model(file)
    assert [effect.name for effect in model.own_effects] == ["piston_leakage_eccentric"]
    assert model.fitted == ("piston_leakage_eccentric.conductance",)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (MODEL.format(file="nowhere.yaml"), r"m.yaml:2:\d+: .*nowhere.yaml"),
        (MODEL.replace("own_effects: [{file}]\n", "").format(), "unknown effect"),
        (MODEL.format(file=EXAMPLE).replace("hydraulic_cylinder", "heater_board"), "another family"),
        (
            MODEL.format(file=EXAMPLE)[:-2] + ", piston_leakage: {}}\n",
            r"m.yaml:3:1: .*contradict one another",
        ),
    ],
)
def test_mistakes_about_own_effects_are_reported_with_their_place(text: str, message: str) -> None:
    with pytest.raises(RigctlError, match=message):
        parse_model(text, Path("m.yaml"))


def test_a_model_file_may_name_a_folder_of_effects(tmp_path: Path) -> None:
    folder = tmp_path / "effects"
    folder.mkdir()
    for name in ("upper", "lower"):
        (folder / f"{name}.yaml").write_text(
            f"effect: {name}\nsummary: Drag.\nslot: friction\nterm: size*velocity/(1 m/s)\n"
            "parameters: {size: {null_value: 0 N, start: 50 N, bounds: [0 N, 500 N]}}\n",
            encoding="utf-8",
        )
    (folder / "notes.yaml").write_text("what: no effect\n", encoding="utf-8")
    text = "model: hydraulic_cylinder\nown_effects: [effects]\n"
    model = parse_model(text, tmp_path / "model.yaml")
    assert [effect.name for effect in model.own_effects] == ["lower", "upper"]
    whole = model.system(library=True).parameter_names
    assert {"lower.size", "upper.size"} <= set(whole)  # the parameters that a diagnosis differentiates
    assert "lower.size" not in model.system().parameter_names
    with pytest.raises(RigctlError, match="two effects have the same name"):
        parse_model(text.replace("[effects]", "[effects, effects/upper.yaml]"), tmp_path / "model.yaml")
