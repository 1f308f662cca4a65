"""A bench that never rests: no green on a guess, and effects that need no noise level."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from commands import answer, told
from rigctl.analysis.agreement.undecided import RepeatedRecord, Rest, StatedNoise, what_decides
from rigctl.analysis.comparison import compare
from rigctl.analysis.diagnosis_result import Diagnosis
from rigctl.answers.errors import in_brief
from rigctl.dataset import open_run
from rigctl.dataset.importing.bring_in import import_file
from rigctl.errors import RigctlError
from rigctl.model.fit.model_error import model_error
from rigctl.model.load import load_model
from rigctl.rig.load import load_rig
from swing import WHITE, diagnosed, project, slow, white

#: a straight line through a damper's force
DAMPER = {
    "families/d.yaml": """
family: d
title: Damper
source: a drawing
inputs: {speed: {value: 0 m/s, meaning: commanded}}
parameters:
  rest: {value: 0 N, bounds: [-900 N, 900 N], meaning: at rest}
  gain: {value: 1 N*s/m, bounds: [-100 N*s/m, 100 N*s/m], meaning: of the speed}
outputs:
  force: {unit: N, formula: rest + gain*speed, meaning: as measured}
""",
    "rigs/d.yaml": """
name: d
model: families/d.yaml
channels:
  force: {unit: N, quantity: force}
actuators: {speed: {kind: level, unit: m/s, low: -50 m/s, high: 50 m/s}}
safe_state: {speed: 0 m/s}
""",
    "models/d.yaml": """
model: families/d.yaml
rig: rigs/d.yaml
parameters:
  rest: {value: 0 N, fit: true}
  gain: {value: 1 N*s/m, fit: true}
""",
    "rigctl.toml": "",
}


def compared(folder: Path) -> Any:
    imported = import_file(folder / "log.csv", load_rig(folder / "rigs/swing.yaml"), folder / "runs")
    (found,) = compare([open_run(imported.path)], [load_model(folder / "models/swing.yaml")]).models
    return found


def test_a_right_model_with_white_errors_is_adequate(tmp_path: Path) -> None:
    project(tmp_path, white)
    found = diagnosed(tmp_path)
    assert found.verdict == "adequate"
    channel = found.document()["channels"]["position"]
    assert channel["noise_standing"] == "floor"
    assert channel["noise"] == pytest.approx(WHITE, rel=0.1)
    assert channel["nrmse"] == pytest.approx(1.0, abs=0.1)


def test_switch_times_are_no_separate_unknowns_of_a_record_with_hardly_more_readings(tmp_path: Path) -> None:
    """Fifty times for 150 readings fit anything; a wrong effect was named for what they left."""
    project(tmp_path, white, cubic=0.6, held=3)
    log = tmp_path / "log.csv"
    log.write_text("\n".join(log.read_text(encoding="utf-8").splitlines()[:151]), encoding="utf-8")
    imported = import_file(log, load_rig(tmp_path / "rigs/swing.yaml"), tmp_path / "runs")
    told_of: list[str] = []
    model = load_model(tmp_path / "models/swing.yaml")
    (compared,) = compare([open_run(imported.path)], [model], on_progress=told_of.append).models
    assert compared.fit.problem.records[0].rough_switches.size == 49
    assert compared.fit.errors["position"].rmse > 2.0 * WHITE
    assert "Fitting swing" in told_of
    assert not any("time of every switch" in one for one in told_of)


def test_slow_noise_that_nobody_states_is_not_decided(tmp_path: Path) -> None:
    project(tmp_path, slow)
    found = diagnosed(tmp_path)
    assert found.verdict == "undecided"
    assert found.effects == ()
    assert found.before.adequacy.verdict is None
    assert model_error(found.before.fit).chi2_reduced is None  # in its own scale it compares no two models
    assert "slow noise or a missing effect" in found.statement
    assert any(isinstance(one, Rest) for one in found.decided_by)
    assert found.title == "Not decided"


@pytest.mark.parametrize("noise", ["white", "slow"])
def test_an_effect_with_which_the_misfit_collapses_is_named_whatever_the_noise(
    tmp_path: Path, cubic_swing: Diagnosis, noise: str
) -> None:
    found = cubic_swing
    if noise == "slow":
        project(tmp_path, slow, cubic=0.6)
        found = diagnosed(tmp_path)
    assert found.verdict in ("missing_effect", "ambiguous")
    assert found.effects == ("cubic_stiffness_on_v",)
    size = next(one for one in found.ranking if one.effect in found.effects).parameters["coefficient"]
    assert size.value == pytest.approx(0.6, abs=4.0 * size.std)


def test_a_repeat_is_proposed_only_where_it_would_count_as_one(tmp_path: Path) -> None:
    """Slow noise of 16 mm makes records that move through two metres start alike, and no others."""
    project(tmp_path, slow)
    found = compared(tmp_path)
    assert any(isinstance(one, RepeatedRecord) for one in found.decided_by)
    measurements = found.fit.problem.measurements
    small = [replace(one, values=0.05 * one.values) for one in measurements.records]
    problem = replace(found.fit.problem, measurements=replace(measurements, records=tuple(small)))
    decides = what_decides(replace(found.fit, problem=problem), ["position"])
    assert not any(isinstance(one, RepeatedRecord) for one in decides)


def test_a_fit_that_starts_at_four_times_the_natural_frequency_locks_on(tmp_path: Path) -> None:
    project(tmp_path, white)
    model = tmp_path / "models/swing.yaml"
    model.write_text(model.read_text("utf-8").replace("value: 4 N/m", "value: 58 N/m"), "utf-8")
    found = compared(tmp_path)
    assert found.fit.errors["position"].rmse == pytest.approx(WHITE, rel=0.1)
    assert found.adequacy.verdict is True


def test_a_fit_leaves_no_more_than_least_squares_with_the_same_parameters(tmp_path: Path) -> None:
    """A damper with hysteresis: weights of falsely correlated noise once gave 44.8 N instead of 32.8 N."""
    for name, text in DAMPER.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text, encoding="utf-8")
    rng, t = np.random.default_rng(5), np.arange(1000) * 0.005
    speed = np.sin(9.0 * t + 2.0 * np.sin(1.1 * t)) * (8.0 + 5.0 * np.sin(0.7 * t))
    bent = np.zeros(t.size)  # Bouc and Wen's hysteresis
    for k in range(t.size - 1):
        bent[k + 1] = bent[k] + 0.005 * (speed[k] - 0.5 * abs(speed[k]) * bent[k])
    force = 4.0 * speed + 30.0 * bent + 0.8 * rng.standard_normal(t.size)
    rows = np.column_stack([t, speed, force])
    np.savetxt(tmp_path / "log.csv", rows, "%.6g", ",", header="time [s],speed [m/s],force [N]", comments="")
    imported = import_file(tmp_path / "log.csv", load_rig(tmp_path / "rigs/d.yaml"), tmp_path / "runs")
    model = load_model(tmp_path / "models/d.yaml")
    (found,) = compare([open_run(imported.path)], [model]).models
    basis = np.column_stack([np.ones(t.size), speed])
    rest = force - basis @ np.linalg.lstsq(basis, force, rcond=None)[0]
    assert found.fit.errors["force"].rmse <= 1.001 * float(np.sqrt(np.mean(rest**2)))
    assert found.adequacy.verdict is not True


def test_a_stated_noise_explains_slow_errors_up_to_its_size(tmp_path: Path) -> None:
    project(tmp_path, slow, stated="{white: 5 mm, slow: 15 mm, over: 2 s}")
    found = diagnosed(tmp_path)
    assert found.verdict == "adequate"
    assert "that the rig file states" in found.statement
    channel = found.document()["channels"]["position"]
    assert channel["noise"] == pytest.approx(WHITE, rel=0.2)
    assert (channel["noise_stated"], channel["noise_over"]) == (pytest.approx(0.0158, rel=0.01), 2.0)
    assert "stated 0.016 m" in in_brief(found.before)[0]
    assert any("times its white noise count as noise" in str(one) for one in found.notes)


def test_a_stated_noise_that_is_slower_than_the_errors_is_not_asked_for_again(tmp_path: Path) -> None:
    project(tmp_path, slow, stated="{white: 5 mm, slow: 15 mm, over: 200 s}")
    found = compared(tmp_path)
    assert found.adequacy.verdict is None
    assert (
        "states a noise of 0.016 m that changes over 200 s, but these errors change within" in found.statement
    )
    assert found.decided_by
    assert not any(isinstance(one, StatedNoise) for one in found.decided_by)


def test_a_stated_noise_in_the_wrong_unit_is_all_that_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    project(tmp_path, slow, stated="15 m")
    monkeypatch.chdir(tmp_path)
    told("import", "log.csv", "--rig", "rigs/swing.yaml")
    text = told("compare", "latest", "--model", "models/swing.yaml")
    assert re.search(r"the rig file states 15 m, 9\d0 times the 0\.016 m that the model leaves", text)
    assert text.count("Not decided") == 1
    assert "decided by" not in text
    assert "diagnose" not in text


@pytest.mark.parametrize("stated", ["1 mm", "200 mm"])
def test_a_stated_noise_that_the_data_contradict_is_said_with_both_numbers(
    tmp_path: Path, stated: str
) -> None:
    project(tmp_path, slow, stated=stated)
    found = diagnosed(tmp_path)
    assert found.verdict == "undecided"
    assert "rig file states" in " ".join([found.statement, *map(str, found.notes)])
    assert "times" in " ".join([found.statement, *map(str, found.notes)])


def test_the_whole_way_prints_a_grey_answer_with_what_would_decide_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    project(tmp_path, slow)
    monkeypatch.chdir(tmp_path)
    told("import", "log.csv", "--rig", "rigs/swing.yaml")
    compared = answer("compare", "latest", "--model", "models/swing.yaml")
    assert compared["adequate"] is None
    assert compared["unproven"] == ["position"]
    assert compared["channels"]["position"]["r2"] > 0.99
    analysis = compared["residuals"]["position"]
    assert analysis["autocorrelation"][1] > analysis["band"]
    assert max(map(abs, analysis["cross_correlation"]["force"])) < 2.0 * analysis["band"]
    text = told("compare", "latest", "--model", "models/swing.yaml", "-o", "page.html")
    assert "Not decided" in text
    assert "within its noise" not in text
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert 'class="statement open"' in page
    assert "Correlation of the errors of position" in page
    assert "its white part alone" in page
    assert "R²" in text
    assert "decided by" in text
    assert json.dumps(compared["decided_by"])


@pytest.mark.parametrize("stated", ["0 m", "{slow: 3 mm}", "{over: 2 s}", "3 bar", "{white: -1 mm}"])
def test_a_stated_noise_that_cannot_be_is_refused_in_one_message(tmp_path: Path, stated: str) -> None:
    project(tmp_path, white, stated=stated)
    with pytest.raises(RigctlError, match=r"noise|slow|over|dimension"):
        load_rig(tmp_path / "rigs/swing.yaml")


def test_a_reading_that_is_its_own_input_is_refused(tmp_path: Path) -> None:
    project(tmp_path, white)
    rows = np.loadtxt(tmp_path / "log.csv", delimiter=",", skiprows=1)
    rows[:, 2] = rows[:, 1]
    np.savetxt(tmp_path / "log.csv", rows, "%.7g", ",", header="time [s],force [N],position [m]", comments="")
    with pytest.raises(RigctlError, match="its readings are those of the input force"):
        diagnosed(tmp_path)
