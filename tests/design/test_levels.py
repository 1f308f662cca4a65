"""A bench that is set to levels: two heaters whose loss the model does not know."""

from __future__ import annotations

from contextlib import chdir
from pathlib import Path

import pytest

from commands import answer, told
from rigctl.cli.init import create_project

pytestmark = pytest.mark.usefixtures("inside")

MODEL = "models/heater-board.yaml"
STEPS = ("procedures/heater-board-steps.yaml", "-a", "powers=20 %, 60 %", "-a", "dwell=10 min")


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two steps of one heater, which radiates."""
    folder = tmp_path_factory.mktemp("levels")
    create_project(folder)
    with chdir(folder):
        told("simulate", *STEPS, "--with", "radiation", "--seed", "3")
    return folder


def test_staircases_or_ramps_are_designed_that_the_bench_takes_without_a_limit_in_sight() -> None:
    run = answer("runs", "show", "latest")["id"]
    before = answer("diagnose", run, "--model", MODEL)
    found = answer("design", run, "--model", MODEL, "--records", "2", "-o", "next.yaml")
    assert found["records"]
    for record in found["records"]:
        assert set(record["settings"]) == {"heater_1", "heater_2"}
        verbs = [line.partition(":")[0] for line in record["steps"]]
        assert verbs in (["set", "wait"] * 4, ["set", "wait"] * 12)  # a staircase, or a ramp there and back
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


def test_a_bench_that_answers_otherwise_than_every_rival_breaks_the_promise() -> None:
    """Between the first steps and the designed ones a thermometer has come to lag behind."""
    first = answer("runs", "list")["runs"][-1]["id"]
    model = Path("models", "changed.yaml")
    model.write_bytes(Path(MODEL).read_bytes())
    how = ("--from", first, "--with", "sensor_lag", "--yes", "--max-rounds", "3")
    learned = answer("learn", STEPS[0], "--model", model.as_posix(), *how)
    assert learned["ended"] == "outside_library"
    assert "the bench answered otherwise than every rival said" in learned["statement"]
    asked, answered = learned["rounds"]
    assert "radiation" in asked["classes"][0]
    assert answered["promised"]["probability"] > 0.5
    assert (answered["came_out"]["kept"], answered["came_out"]["winner"]) == (False, "")
    assert learned["added"] == []
    kept = answer("model", "history", model.as_posix())["versions"]
    assert [one["kind"] for one in kept] == ["start"]
