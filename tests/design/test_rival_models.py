"""`rigctl design` with several models: which of them is right, for tables and for records over time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from commands import answer, refusal, told
from rigctl.cli.commands.init import create_project
from rigctl.design import rival_models
from rigctl.design.rivals import _extends
from rigctl.model import load_model

pytestmark = pytest.mark.usefixtures("inside")

RIG = """
name: spring
model: families/linear.yaml
channels:
  force: {unit: N, quantity: force, noise: 0.05 N}
actuators:
  stretch: {kind: level, unit: "1", low: 0, high: 4}
  hot: {kind: switch}
safe_state: {stretch: 0, hot: off}
"""
FAMILY = """
family: NAME
inputs:
  stretch: {value: 1}
  hot: {value: 0}
parameters:
  rate: {value: 1 N, bounds: [0.001 N, 100 N]}
  soft: {value: 0.1, bounds: [0.001, 10]}
outputs:
  force: {unit: N, formula: FORMULA}
"""
FORMULAS = {
    "linear": "stiff*stretch",
    "hard": "stiff*stretch^2",
    "softer": "stiff*stretch/(1 + soft*hot)",
    "harder": "stiff*stretch^2/(1 + soft*hot)",
}
TANK_RIG = """
name: tank
model: families/orifice.yaml
channels:
  level: {unit: m, quantity: position, noise: 2 mm, range: [0 m, 2 m]}
actuators:
  inflow: {kind: level, unit: l/min, low: 0 l/min, high: 6 l/min}
safe_state: {inflow: 0 l/min}
backend: {kind: simulated}
simulation: {initial: {level: 0.5 m}}
"""
TANK = """
family: NAME
states:
  level: {start: 0.5 m, scale: 1 mm, rate: "(inflow - OUT)/base"}
inputs:
  inflow: {value: 0 l/min}
parameters:
  drain: {value: 0.0001 UNIT, bounds: [0.000001 UNIT, 0.01 UNIT]}
constants:
  base: 0.05 m^2
  gravity: 9.81 m/s^2
outputs:
  level: {unit: m, formula: level}
"""
OUTFLOWS = {
    "orifice": ("drain*sqrt(2*gravity*positive_part(level, 1 mm))", "m^2"),
    "bed": ("drain*level", "m^2/s"),
}


def _write(folder: Path, name: str, family: str, free: str) -> None:
    (folder / "families" / f"{name}.yaml").write_text(family, encoding="utf-8")
    rig = "rigs/tank.yaml" if "level" in family else "rigs/spring.yaml"
    text = f"model: families/{name}.yaml\nrig: {rig}\nparameters:\n{free}"
    (folder / "models" / f"{name}.yaml").write_text(text, encoding="utf-8")


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("spring")
    create_project(folder)
    for kind in ("families", "rigs", "models"):
        (folder / kind).mkdir(exist_ok=True)
    (folder / "rigs" / "spring.yaml").write_text(RIG, encoding="utf-8")
    for name, formula in FORMULAS.items():
        family = FAMILY.replace("NAME", name).replace("FORMULA", formula).replace("rate:", "stiff:")
        free = "  stiff: {value: 1 N, fit: true}\n"
        if "soft" in formula:
            free += "  soft: {value: 0.1, fit: true}\n"
        else:
            family = "\n".join(line for line in family.splitlines() if "soft:" not in line)
        _write(folder, name, family, free)
    (folder / "rigs" / "tank.yaml").write_text(TANK_RIG, encoding="utf-8")
    for name, (out, unit) in OUTFLOWS.items():
        family = TANK.replace("NAME", name).replace("OUT", out).replace("UNIT", unit)
        _write(folder, name, family, f"  drain: {{value: 0.0001 {unit}, fit: true}}\n")
    return folder


def _imported(name: str, stretch: list[float], hot: list[float], force: list[float]) -> str:
    rows = [f"{s},{h},{f:.6g}" for s, h, f in zip(stretch, hot, force, strict=True)]
    Path(f"{name}.csv").write_text("\n".join(["stretch,hot,force [N]", *rows, ""]), encoding="utf-8")
    return str(answer("import", f"{name}.csv", "--rig", "rigs/spring.yaml")["run"])


def _models(*names: str) -> list[str]:
    return [word for name in names for word in ("--model", f"models/{name}.yaml")]


def test_the_row_at_which_the_models_differ_most_is_proposed() -> None:
    """A line and a parabola through the origin, measured where they agree, differ most at the ends."""
    stretch = [0.98, 1.0, 1.02, 1.04]
    run = _imported("near", stretch, [0, 1, 0, 1], [0.99, 1.03, 1.0, 1.02])
    found = answer("design", run, *_models("linear", "hard"), "--records", "1")
    assert {one["name"] for one in found["rivals"]} == {"linear", "hard"}
    assert found["excluded"] == []
    (row,) = found["records"]
    assert float(row["settings"]["stretch"]) < min(stretch) or float(row["settings"]["stretch"]) > max(
        stretch
    )
    assert row["settings"]["hot"] in ("0", "1")  # a switch has no other positions


def test_the_model_that_made_the_data_is_the_only_one_left() -> None:
    stretch = [0.5, 1.0, 1.5, 2.0, 3.0, 3.5]
    run = _imported("line", stretch, [0, 1] * 3, [2.0 * s + 0.01 for s in stretch])
    said = refusal("design", run, *_models("hard", "linear"))
    assert "nothing is left to distinguish: the odds of linear against hard are more than 100 to 1" in said


def test_of_models_that_contain_one_another_the_simplest_is_named() -> None:
    stretch, hot = [0.5, 1.0, 1.5, 2.0, 3.0, 3.5], [0, 1, 0, 1, 0, 1]
    run = _imported("cold", stretch, hot, [2.0 * s + 0.02 * (-1) ** k for k, s in enumerate(stretch)])
    said = refusal("design", run, *_models("softer", "linear"))
    assert "linear is the simplest model that these data leave; softer fits whatever linear predicts" in said


def test_excluded_models_are_named_and_are_no_rivals() -> None:
    stretch, hot = [0.5, 1.0, 1.5, 2.0, 3.0, 3.5], [0, 1, 0, 1, 0, 1]
    run = _imported(
        "warm", stretch, hot, [2.0 * s / (1 + 0.03 * h) for s, h in zip(stretch, hot, strict=True)]
    )
    found = answer("design", run, *_models("linear", "hard", "softer", "harder"))
    assert set(found["excluded"]) == {"hard", "harder"}
    assert {one["name"] for one in found["rivals"]} == {"linear", "softer"}
    assert "excluded    hard and harder, with odds of more than 100 to 1" in told(
        "design", run, *_models("linear", "hard", "softer", "harder")
    )


def test_effects_are_not_distinguished_between_models(bench: Path) -> None:
    run = _imported("some", [0.5, 1.0, 2.0], [0, 1, 0], [1.0, 2.0, 4.0])
    said = refusal("design", run, *_models("linear", "hard"), "--separate", "a,b")
    assert "effects are distinguished in one model" in said
    assert "two of the models have the same name" in refusal("design", run, *_models("linear", "linear"))


def _tank_run(name: str, rig: str = "tank") -> str:
    times = np.arange(0.0, 60.0, 2.0)
    solved = solve_ivp(
        lambda _, y: [(2e-3 / 60.0 - 1.2e-4 * np.sqrt(y[0])) / 0.05],
        (0.0, 60.0),
        [0.5],
        t_eval=times,
        rtol=1e-9,
    )
    noise = np.random.default_rng(1).normal(0.0, 2e-3, times.size)
    rows = [f"{t:g},{y:.6f},2" for t, y in zip(times, solved.y[0] + noise, strict=True)]
    text = "\n".join(["time [s],level [m],inflow [l/min]", *rows, ""])
    Path(f"{name}.csv").write_text(text, encoding="utf-8")
    return str(answer("import", f"{name}.csv", "--rig", f"rigs/{rig}.yaml")["run"])


def test_a_record_is_designed_for_models_over_time() -> None:
    """For a minute, an outflow in proportion to the level fits a tank that drains through an orifice."""
    run = _tank_run("tank")
    found = answer("design", run, *_models("orifice", "bed"), "--records", "1")
    assert {one["name"] for one in found["rivals"]} == {"orifice", "bed"}
    assert found["probability"] > found["probability_before"]
    Path("next.yaml").write_text(found["procedure"], encoding="utf-8")
    assert "1 record" in told("check", "next.yaml")


LATE = """
effects:
  dead_time_of_inflow:
    time: {value: 1 s, fit: true}
"""


def test_a_record_is_designed_that_would_show_what_one_model_has_in_addition(bench: Path) -> None:
    """No record shows that the delay is not there: that used to count as not distinguishable here."""
    plain = (bench / "models" / "orifice.yaml").read_text(encoding="utf-8")
    (bench / "models" / "late.yaml").write_text(plain + LATE, encoding="utf-8")
    found = answer("design", _tank_run("steady"), *_models("orifice", "late"), "--records", "1")
    assert [(one["truth"], one["rival"]) for one in found["outlooks"]] == [("late", "orifice")]
    assert found["probability"] > 0.9 > found["probability_before"]


def test_models_that_differ_in_a_fixed_value_contain_neither_the_other(bench: Path) -> None:
    text = (bench / "models" / "orifice.yaml").read_text(encoding="utf-8")
    narrow = bench / "models" / "narrow.yaml"
    narrow.write_text(text.replace("fit: true", "fit: false") + LATE, encoding="utf-8")
    (bench / "models" / "late.yaml").write_text(text + LATE, encoding="utf-8")
    (bench / "models" / "fixed.yaml").write_text(
        text + LATE.replace("fit: true", "fit: false"), encoding="utf-8"
    )
    model = {name: load_model(bench / "models" / f"{name}.yaml") for name in ("orifice", "late", "fixed")}
    assert _extends(model["late"], model["orifice"])
    assert not _extends(model["orifice"], model["late"])
    assert not _extends(model["fixed"], model["orifice"])  # its delay cannot be switched off
    assert not _extends(load_model(narrow), model["orifice"])  # its drain cannot be moved


def test_the_same_model_twice_leaves_nothing_to_distinguish(bench: Path) -> None:
    text = (bench / "models" / "orifice.yaml").read_text(encoding="utf-8")
    (bench / "models" / "again.yaml").write_text(text, encoding="utf-8")
    said = refusal("design", _tank_run("twice"), *_models("orifice", "again"))
    assert "are the same model" in said


def test_a_sensor_that_one_of_the_models_cannot_predict_is_left_out(bench: Path) -> None:
    """Of a bed nobody knows where it drains."""
    meters = """
could_have:
  outflow: {unit: l/min, quantity: flow, noise: 0.05 l/min}
  float: {unit: m, quantity: position, reads: level, noise: 1 mm}
"""
    (bench / "rigs" / "metered.yaml").write_text(TANK_RIG + meters, encoding="utf-8")
    out, unit = OUTFLOWS["orifice"]
    family = TANK.replace("NAME", "metered").replace("OUT", "outflow").replace("UNIT", unit)
    family += f'definitions:\n  outflow: {{unit: m^3/s, formula: "{out}", meaning: of the tank}}\n'
    _write(bench, "metered", family, f"  drain: {{value: 0.0001 {unit}, fit: true}}\n")
    for name in ("metered", "bed"):
        model = bench / "models" / f"{name}.yaml"
        text = model.read_text(encoding="utf-8").replace("tank.yaml", "metered.yaml")
        (bench / "models" / f"{name}-equipped.yaml").write_text(text, encoding="utf-8")
    run = _tank_run("equipped", "metered")
    found = answer("design", run, *_models("metered-equipped", "bed-equipped"), "--records", "1", "--sensors")
    assert len(found["records"]) == 1
    assert [one["channels"] for one in found["sensors"]] == [["float"]]


def test_a_model_without_anything_to_fit_is_a_rival(bench: Path) -> None:
    text = (bench / "models" / "bed.yaml").read_text(encoding="utf-8")
    known = text.replace("0.0001 m^2/s, fit: true", "0.000175 m^2/s")
    (bench / "models" / "known.yaml").write_text(known, encoding="utf-8")
    assert known != text
    found = answer("design", _tank_run("known"), *_models("orifice", "known"), "--records", "1")
    assert {one["name"] for one in found["rivals"]} == {"orifice", "known"}
    assert len(found["records"]) == 1


def test_models_of_other_inputs_are_refused_before_any_is_fitted(
    bench: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    family = TANK.replace("NAME", "closed").replace("(inflow - OUT)", "(0 m^3/s - drain)")
    family = family.replace("UNIT", "m^3/s").replace("inputs:\n  inflow: {value: 0 l/min}\n", "")
    _write(bench, "closed", family, "  drain: {value: 0.0001 m^3/s, fit: true}\n")
    run = _tank_run("closed")
    monkeypatch.setattr(rival_models, "fit_to_data", None)
    said = refusal("design", run, *_models("orifice", "closed"))
    assert "orifice and closed are not of one bench: their inputs differ" in said
