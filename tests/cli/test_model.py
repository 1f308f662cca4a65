"""`rigctl model`: shown, compared, its history, and an effect taken out."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import pytest

import commands
from commands import MODEL
from rigctl.answers.model.change import fitted_values
from rigctl.cli.commands.init import create_project
from rigctl.errors import RigctlError
from rigctl.model import Change, ModelError, load_model, save_version
from rigctl.model.value_table import StatedValue

said = partial(commands.told, "model")
answer = partial(commands.answer, "model")


@pytest.fixture(autouse=True)
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    create_project(tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def error(fitted: float, held_out: float) -> ModelError:
    return ModelError(
        {"position": fitted}, 10.0 * fitted, {"position": held_out}, {"position": "mm"}, {"position": 0.02}
    )


def with_leakage() -> None:
    model = load_model(Path(MODEL)).with_effect("piston_leakage", {})
    found = {"flow_area": 3.31e-6, "piston_leakage.conductance": 4.1e-15}
    std = {"flow_area": 3.1e-9, "piston_leakage.conductance": 1.1e-16}
    done = Change(
        "add",
        effect="piston_leakage",
        runs=("20261121-064500-stroke",),
        hold_out="oil == 60 degC",
        before=error(1.6, 1.7),
        after=error(0.1, 0.11),
    )
    save_version(model.with_values(found, std=std, source="fitted 2026-11-21"), Path(MODEL), done)


def test_a_fresh_model_is_its_first_version() -> None:
    shown = answer("show", MODEL)
    assert (shown["version"], shown["kept"], shown["effects"]) == (1, False, [])
    assert shown["family"] == "hydraulic_cylinder"
    assert shown["readings"] == ["oil_temperature", "supply_pressure", "position"]
    values = {value["name"]: value for value in shown["parameters"]}
    assert set(values) == set(load_model(Path(MODEL)).values)
    area = values["flow_area"]
    assert (area["value"], area["unit"], area["std"], area["fit"]) == (4.05, "mm^2", None, True)
    assert [values[name]["origin"] for name in ("flow_area", "bore", "vogel_a", "load_force")] == [
        "model",
        "rig",
        "oil",
        "family",
    ]
    assert values["bore"]["fixed"]
    (only,) = answer("history", MODEL)["versions"]
    assert (only["done"], only["kept"]) == ("first version", False)
    assert not Path("models/.history").exists()  # showing a model changes nothing


def test_show_prints_values_with_uncertainty_and_source() -> None:
    with_leakage()
    text = said("show", MODEL)
    (line,) = [line for line in text.splitlines() if "flow_area" in line]
    assert "3.3100 ± 0.0031" in " ".join(line.split())
    assert "fitted 2026-11-21" in line
    assert "effect piston_leakage at flow_a_to_b" in text
    values = {value["name"]: value for value in answer("show", MODEL)["parameters"]}
    leak = values["piston_leakage.conductance"]
    assert (leak["value"], leak["std"], leak["unit"], leak["from"]) == (
        4.1e-15,
        1.1e-16,
        "m^3",
        "fitted 2026-11-21",
    )
    assert answer("show", f"{MODEL}@1")["effects"] == []


def test_history_draws_the_error_of_each_version_down_to_the_noise() -> None:
    with_leakage()
    told = answer("history", MODEL)
    assert told["current"] == 2
    assert [version["done"] for version in told["versions"]] == ["first version", "add piston_leakage"]
    assert told["versions"][1]["runs"] == ["20261121-064500-stroke"]
    assert told["versions"][1]["after"]["chi2_reduced"] == pytest.approx(1.0)
    assert [(each["version"], each["rmse"]["position"]) for each in told["errors"]] == [(1, 1.6), (2, 0.1)]
    lines = said("history", MODEL, "-v").splitlines()
    bars = [line.count("█") for line in lines if "█" in line]
    assert bars == [37, 40, 2, 2]
    assert any("noise" in line and line.endswith("0.02") for line in lines)


def test_history_first_compares_the_errors_of_versions_on_the_same_records() -> None:
    with_leakage()
    lines = said("history", MODEL).splitlines()
    assert lines[0] == f"{MODEL}: version 2 of 2, add piston_leakage."
    assert "1 first version, 2 add piston_leakage" in lines[1]
    # 0.1 mm less the noise of 0.02 mm: sqrt(0.1^2 - 0.02^2)
    assert (
        "from version 1 to 2, 4 to 1 times the noise; beyond the noise: position 1.6 mm to 0.098 mm"
        in lines[2]
    )
    assert "held out    beyond the noise: position 1.7 mm to 0.11 mm" in lines[3]
    assert len(lines) <= 5
    done = Change("fit", runs=("20261121-064500-stroke",), before=error(0.1, 0.1), after=error(0.02, 0.02))
    save_version(load_model(Path(MODEL)), Path(MODEL), done)
    # nothing was held out for the third: the output states that it is not compared with the first two
    text = said("history", MODEL)
    assert "of version 3: position none beyond the noise" in text
    assert "not all errors were computed on the same runs" in text
    assert "position 1.6 mm" not in text


def test_diff_lists_effects_and_changed_values() -> None:
    with_leakage()
    told = answer("diff", f"{MODEL}@1", MODEL)
    assert told["effects"] == {"added": ["piston_leakage"], "removed": []}
    area, leak = told["parameters"]
    assert (area["name"], area["before"]["value"], area["after"]["value"]) == ("flow_area", 4.05, 3.31)
    assert area["change"] == pytest.approx(-0.18272, rel=1e-4)
    assert area["deviations"] == pytest.approx(0.74 / 0.0031)
    assert (leak["name"], leak["before"], leak["deviations"]) == ("piston_leakage.conductance", None, None)
    assert answer("diff", MODEL, f"{MODEL}@1")["effects"]["removed"] == ["piston_leakage"]
    assert answer("diff", MODEL, f"{MODEL}@2")["same"]
    assert "do not differ" in said("diff", MODEL, MODEL)
    text = said("diff", f"{MODEL}@1", MODEL)
    assert "+ piston_leakage" in text
    assert "-18.3 %" in text
    with pytest.raises(RigctlError, match="different families"):
        said("diff", MODEL, "models/heater-board.yaml")


def test_remove_writes_the_next_version() -> None:
    first = Path(MODEL).read_bytes()
    with_leakage()
    assert answer("remove", MODEL, "piston_leakage") == {
        "model": MODEL,
        "version": 3,
        "parent": 2,
        "effect": "piston_leakage",
        "runs": [],
        "hold_out": None,
        "only": None,
        "assume": [],
        "before": None,
        "after": None,
        "bounds": [],
        "undetermined": [],
        "parameters": {},
        "outside_validity": [],
    }
    assert load_model(Path(MODEL)).effects == {}
    assert "version 4, without spool_lag" in said("remove", MODEL, "spool_lag")
    assert load_model(Path(MODEL)).values["spool_time"] == pytest.approx(1e-3)
    assert Path("models/.history/hl32-textbook/001.yaml").read_bytes() == first
    with pytest.raises(RigctlError, match="did you mean 'spool_lag'"):
        said("remove", MODEL, "spool_lagg")


def test_values_are_set_by_hand_as_the_next_version() -> None:
    with_leakage()
    said_so = answer(
        "set", MODEL, "flow_area=3.9 mm^2", "--remove", "piston_leakage", "--add", "valve_leakage"
    )
    assert (said_so["version"], said_so["parent"], said_so["before"]) == (3, 2, None)
    shown = {one["name"]: one for one in answer("show", MODEL)["parameters"]}
    assert (shown["flow_area"]["value"], shown["flow_area"]["std"]) == (pytest.approx(3.9), None)
    assert shown["flow_area"]["from"].startswith("set by hand")
    assert "valve_leakage.conductance" in shown
    assert not any(name.startswith("piston_leakage") for name in shown)
    assert "with valve_leakage; without piston_leakage" in said("history", MODEL)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ((), "nothing to set"),
        (("flow_aera=3.9 mm^2",), "flow_area"),
        (("flow_area=3.9 bar",), "flow_area"),
        (("flow_area=-1 mm^2",), "out of bounds"),
        (("piston_leakage.conductance=1e-15 m^3",), "no parameter|unknown"),
        (("flow_area",), "name=value"),
        (
            ("flow_area=3.9 mm^2", "--assume", "heatr=0"),
            "--assume .* no run was named. Name .* '--run'",
        ),
    ],
)
def test_an_invalid_setting_is_refused_and_makes_no_version(words: tuple[str, ...], message: str) -> None:
    with pytest.raises(RigctlError, match=message):
        said("set", MODEL, *words)
    assert len(answer("history", MODEL)["versions"]) == 1


def test_a_model_that_comes_with_rigctl_is_not_changed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "rigctl.toml").touch()
    monkeypatch.chdir(elsewhere)
    assert answer("show", MODEL)["version"] == 1
    with pytest.raises(RigctlError, match="comes with rigctl"):
        said("remove", MODEL, "spool_lag")


def test_a_version_is_accepted_wherever_a_model_file_is(tmp_path: Path) -> None:
    import rigctl
    from rigctl.project import find_file, find_project

    with_leakage()
    assert find_file(Path(f"{MODEL}@1")) == Path(f"{MODEL}@1")
    assert find_project().resolve(f"{MODEL}@1") == tmp_path / f"{MODEL}@1"
    runs = [
        rigctl.simulate("procedures/quick-check.yaml", plant=plant, seed=1, runs=tmp_path / name).run
        for name, plant in (("a", f"{MODEL}@1"), ("b", MODEL))
    ]
    first, second = (run.table("samples")["position"].to_numpy() for run in runs)
    assert abs(first[: len(second)] - second[: len(first)]).max() > 1e-3


def test_a_number_without_a_unit_is_not_followed_by_a_one() -> None:
    """``size 31.76 ± 0.24``, not ``size 31.76 ± 0.24 1``."""
    known = {"std": 0.2, "fit": True, "fixed": False, "origin": "effect", "source": "", "meaning": ""}
    ratio = StatedValue(name="worn.size", si=31.76, unit="1", **known)
    mass = StatedValue(name="worn.mass", si=2.0, unit="kg", **known)
    assert fitted_values([ratio, mass], {}) == "worn.size 31.76 ± 0.20, worn.mass 2.00 ± 0.20 kg"
