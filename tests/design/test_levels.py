"""A bench with level actuators: two heaters with a loss that the model lacks."""

from __future__ import annotations

import re
from contextlib import chdir
from pathlib import Path

import pytest

from commands import answer, refusal, told, with_exact_sensors
from rigctl.analysis.comparison import compare
from rigctl.cli.commands.init import create_project
from rigctl.dataset import open_run
from rigctl.design.rivals import Rival, at_usual_size
from rigctl.model import load_model

pytestmark = pytest.mark.usefixtures("inside")

MODEL = "models/heater-board.yaml"
RIG = Path("rigs", "heater-board.yaml")
STEPS = ("procedures/heater-board-steps.yaml", "-a", "powers=20 %, 60 %", "-a", "dwell=10 min")


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two steps of one heater, which radiates."""
    folder = tmp_path_factory.mktemp("levels")
    create_project(folder)
    with chdir(folder):
        with_exact_sensors(RIG)
        told("simulate", *STEPS, "--with", "radiation", "--seed", "3")
    return folder


def test_designed_staircases_or_ramps_run_without_warnings_and_shrink_the_class() -> None:
    run = answer("runs", "show", "latest")["id"]
    before = answer("diagnose", run, "--model", MODEL)
    found = answer("design", run, "--model", MODEL, "--records", "2", "-o", "next.yaml")
    assert found["records"]
    for record in found["records"]:
        assert set(record["settings"]) == {"heater_1", "heater_2"}
        verbs = [line.partition(":")[0] for line in record["steps"]]
        # a staircase, a ramp there and back, or a multisine of one heater
        assert verbs in (["set", "wait"] * 4, ["set", "wait"] * 12, ["waveform"])
        assert record["expected_separation"] > record["separation_of_repeat"]
    assert "finally:" in found["procedure"]  # the heaters are not left on
    assert answer("check", "next.yaml")["warnings"] == []
    done = answer("simulate", "next.yaml", "--with", "radiation", "--seed", "5")
    assert done["status"] == "finished"
    assert answer("runs", "show", "latest")["records"]
    after = answer("diagnose", run, "latest", "--model", MODEL)
    count = [sum(len(names) for names in one["classes"]) for one in (before, after)]
    assert count[1] < count[0]
    assert "radiation" in {name for names in after["classes"] for name in names}


def test_learning_ends_if_the_bench_contradicts_every_rival() -> None:
    """Between the first steps and the designed ones a thermometer begins to lag."""
    first = answer("runs", "list")["runs"][-1]["id"]
    model = Path("models", "changed.yaml")
    model.write_bytes(Path(MODEL).read_bytes())
    how = ("--from", first, "--with", "sensor_lag", "--yes", "--max-rounds", "3")
    learned = answer("learn", STEPS[0], "--model", model.as_posix(), *how)
    assert learned["ended"] == "outside_library"
    assert "the bench behaved differently from every rival's prediction" in learned["statement"]
    asked, answered = learned["rounds"]
    assert "radiation" in asked["classes"][0]
    assert answered["promised"]["probability"] > 0.5
    assert (answered["came_out"]["kept"], answered["came_out"]["winner"]) == (False, "")
    assert learned["added"] == []
    kept = answer("model", "history", model.as_posix())["versions"]
    assert [one["kind"] for one in kept] == ["start"]


def test_an_adequate_model_needs_no_design_if_no_effect_of_usual_size_could_be_missed() -> None:
    told("simulate", *STEPS, "--seed", "6")
    said = refusal("design", "latest", "--model", MODEL)
    assert "nothing is left to distinguish: adequate" in said
    assert "'--separate A,B' designs for two effects of your choice" in said


def test_the_misfit_of_an_unfitted_effect_does_not_count_as_overdispersion() -> None:
    """At its usual size it misses these data by far; the noise is still that of the model without it."""
    told("simulate", *STEPS, "--seed", "6")  # without radiation, whichever tests ran before
    run = open_run("latest")
    (compared,) = compare([run], [load_model(MODEL)]).models
    trial = at_usual_size(compared, "radiation")
    assert trial is not None
    assert trial.fit.chi2_reduced > 100.0
    assert Rival("radiation", trial, 0.0, 1.0, noise=1.2).overdispersion == 1.2
    free = {unknown.name for unknown in trial.fit.problem.shared}
    assert free == {*(one.name for one in compared.fit.problem.shared), "radiation.area"}


def test_records_tell_a_loss_from_a_thermometer_that_is_wrong_within_its_calibration() -> None:
    """Thermometers within ±1 K of the truth may explain two steps; at higher temperatures they do not."""
    exact = RIG.read_bytes()
    RIG.write_text(re.sub(r"(?<=uncertainty: )[\d.]+", "1", exact.decode()), "utf-8")
    try:
        told("simulate", *STEPS, "--with", "radiation", "--seed", "3")
        run = answer("runs", "show", "latest")["id"]
        before = answer("diagnose", run, "--model", MODEL)
        assert before["explained_by"] == "calibration"
        assert "rigctl design" in told("diagnose", run, "--model", MODEL)
        found = answer("design", run, "--model", MODEL, "--records", "2", "-o", "sensor.yaml")
        assert found["rivals"][-1]["name"] == "none"
        assert sum(one["weight"] for one in found["rivals"][:-1]) == pytest.approx(1.0)
        assert "tell these 3 explanations apart" in found["statement"]
        told("simulate", "sensor.yaml", "--with", "radiation", "--seed", "5")
        after = answer("diagnose", run, "latest", "--model", MODEL)
        assert after["explained_by"] is None
        assert "radiation" in {*after["effects"], *(name for names in after["classes"] for name in names)}
    finally:
        RIG.write_bytes(exact)
