"""From an ambiguous campaign to the records that resolve it, with commands only."""

from __future__ import annotations

import json
from contextlib import chdir
from pathlib import Path
from typing import Any

import pytest

from commands import MODEL, answer, refusal, told, with_exact_sensors
from rigctl.cli.commands.init import create_project
from rigctl.dataset import open_run
from rigctl.design import search
from rigctl.design.design import design_experiment
from rigctl.design.result import DesignResult
from rigctl.files.write import to_json
from rigctl.model import load_model
from rigctl.planning.preview import preview
from rigctl.procedure.expand import expand
from rigctl.procedure.load import parse_procedure
from rigctl.tasks import Workers

pytestmark = pytest.mark.usefixtures("inside")

#: a campaign at one temperature leaves dry friction and drifts with the temperature in one class
CAMPAIGN = ("procedures/campaign.yaml", "-a", "temperatures=20 degC", "-a", "pressures=30 bar, 50 bar")


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project with two strokes of a cylinder whose seals stick."""
    folder = tmp_path_factory.mktemp("design")
    create_project(folder)
    with chdir(folder):
        with_exact_sensors(Path("rigs", "hl32-bench.yaml"))
        told("simulate", *CAMPAIGN, "--with", "stribeck_friction", "--seed", "4")
    return folder


@pytest.fixture(scope="module")
def run(bench: Path) -> str:
    """The campaign's run."""
    with chdir(bench):
        return str(answer("runs", "show", "latest")["id"])


@pytest.fixture(scope="module")
def designed(bench: Path, run: str) -> dict[str, Any]:
    """The answer of the command, which also writes its files."""
    with chdir(bench):
        return answer(
            "design", run, "--model", MODEL, "--records", "2", "-o", "next.yaml", "--page", "next.html"
        )


def test_the_designed_records_separate_the_class(designed: dict[str, Any]) -> None:
    names = {one["name"] for one in designed["rivals"]}
    assert {"coulomb_friction", "laminar_throttle"} < names
    (third,) = names - {"coulomb_friction", "laminar_throttle"}
    assert third.endswith("_thermal_drift")  # at one temperature they are alike
    assert designed["aim"] == "discrimination"
    assert sum(one["weight"] for one in designed["rivals"]) == pytest.approx(1.0)
    assert designed["probability_before"] < 0.01 < 0.5 < designed["probability"]
    assert 0 < len(designed["records"]) <= 2
    assert designed["duration"] == pytest.approx(sum(one["duration"] for one in designed["records"]))
    chances = [one["probability"] for one in designed["records"]]
    assert chances[-1] == pytest.approx(designed["probability"])
    assert all(one["separation_of_repeat"] < designed["expected_separation"] for one in designed["records"])


def test_the_written_procedure_runs_and_shrinks_the_class(designed: dict[str, Any], run: str) -> None:
    text = Path("next.yaml").read_text("utf-8")
    assert text == designed["procedure"]
    assert text.startswith("# Written by 'rigctl design'")
    checked = answer("check", "next.yaml")
    assert checked["warnings"] == []
    assert checked["records"] == len(designed["records"])
    assert checked["duration"] == pytest.approx(designed["duration"], abs=1.0)
    told("simulate", "next.yaml", "--with", "stribeck_friction", "--seed", "11")
    after = answer("diagnose", run, "latest", "--model", MODEL)
    (left,) = after["classes"]
    assert set(left) <= {"stribeck_friction", "coulomb_friction"}


def test_the_procedure_sweeps_the_variables_of_the_campaign(designed: dict[str, Any]) -> None:
    assert "for: {oil: [" in designed["procedure"]
    assert "supply: [" in designed["procedure"]


def test_the_page_draws_what_each_rival_predicts(designed: dict[str, Any]) -> None:
    page = Path("next.html").read_text("utf-8")
    for words in (
        "What to measure next",
        "what each rival predicts",
        "± twice the noise of a reading",
        "The procedure",
    ):
        assert words in page
    assert "coulomb friction" in page


def test_a_diagnosis_that_leaves_a_class_names_the_next_experiment(run: str) -> None:
    found = answer("diagnose", run, "--model", MODEL, "--design", "-o", "diagnosis.html")
    told_of = found["next_experiment"]
    wanted = {"procedure", "separates", "expected_separation", "probability", "duration", "records", "sensor"}
    assert set(told_of) == wanted
    assert told_of["records"]
    assert "What to measure next" in Path("diagnosis.html").read_text("utf-8")
    assert answer("diagnose", run, "--model", MODEL)["next_experiment"] is None
    assert "rigctl design" in told("diagnose", run, "--model", MODEL)


def test_no_separation_from_a_more_general_law_is_predicted(run: str) -> None:
    """Stribeck friction becomes Coulomb friction where the static force equals the kinetic. Linearised at its
    fit it cannot reach this limit, and D exceeds 20; refitted it does, and no difference is left."""
    pair = ("coulomb_friction", "stribeck_friction")
    found = design_experiment([open_run(run)], load_model(MODEL), separate=pair, records=1)
    chances = {(one.truth, one.rival): one for one in found.outlooks}
    assert chances[pair].after < 0.05
    assert chances[pair].separation < 9.2
    assert not found.separable


def test_the_design_keeps_within_its_budget(run: str) -> None:
    found = answer("design", run, "--model", MODEL, "--budget", "3m", "--records", "1")
    assert found["duration"] <= 180.0
    assert len(found["records"]) == 1
    # the suggested command wrote another design: without the options of this one
    chosen = ("--budget", "3m", "--records", "1", "--seed", "2", "--only", "record > 1")
    shown = told("design", run, "--model", MODEL, *chosen)
    suggested = '--budget 3m --records 1 --seed 2 --only "record > 1"'
    assert f"rigctl design {run} --model {MODEL} {suggested}" in shown


@pytest.fixture(scope="module")
def result(bench: Path, run: str) -> DesignResult:
    """By Python, in two processes that share the candidates."""
    with chdir(bench), pytest.MonkeyPatch.context() as patch:
        patch.setattr(search, "_AT_ONCE", 4)
        return design_experiment([open_run(run)], load_model(MODEL), records=2, workers=Workers(2))


def test_every_predicted_course_stays_within_the_limits(result: DesignResult) -> None:
    """An independent check of the predictions: no rival comes within three sigmas of a limit."""
    for record in result.records:
        for one in record.predictions:
            for course in one.by_rival.values():
                if one.channel == "position":
                    assert (course + 3.0 * one.sigma).max() < 240.0  # over_travel, mm
                    assert (course - 3.0 * one.sigma).min() > -3.0  # position_slips
                if one.channel == "supply_pressure":
                    assert (course + 3.0 * one.sigma).max() < 60.0  # over_pressure, bar
                if one.channel == "oil_temperature":
                    assert (course + 3.0 * one.sigma).max() < 85.0  # oil_hot, degC


def test_the_design_does_not_depend_on_the_number_of_workers(
    designed: dict[str, Any], result: DesignResult
) -> None:
    """By the command in one process, and by Python in two others."""
    assert result.procedure == designed["procedure"]
    assert json.loads(to_json(result.as_json())) == designed


def test_the_duration_of_the_design_agrees_with_the_preview(result: DesignResult) -> None:
    model = load_model(MODEL)
    assert model.rig is not None
    found = preview(expand(parse_procedure(result.procedure), model.rig))
    assert found.seconds == pytest.approx(result.duration, abs=1.0)
    assert not found.warnings


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--separate", "coulomb_frictoin,none"), "did you mean 'coulomb_friction'"),
        (("--separate", "coulomb_friction"), "two names are needed"),
        (("--separate", "none,none"), "cannot be distinguished from itself"),
        (("--budget", "5 s"), "the budget is too small for any record"),
        (("--budget", "30 mm"), "no time"),
        (("--budget", "-3 min"), "no time is left"),
        (("-o", "procedures/campaign.yaml"), "a file of another kind exists already"),
    ],
)
def test_invalid_requests_are_refused_with_a_clear_message(
    run: str, options: tuple[str, ...], words: str
) -> None:
    assert words in refusal("design", run, "--model", MODEL, *options)
