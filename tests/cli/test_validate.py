"""`rigctl validate`: its tables, and resuming from stored results."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import pytest
from typer.testing import CliRunner

from commands import refusal
from rigctl.cli.catalogue import BY_NAME
from rigctl.cli.main import app
from rigctl.errors import ExitCode, RigctlError
from rigctl_validation.outcome import Outcome, TrialOutcome
from rigctl_validation.scenario import Scenario, Wanted
from rigctl_validation.small_benches.trial import BenchTrial

SCENARIOS = (
    Scenario("nothing", seed=1),
    Scenario("one", (Wanted("valve_leakage", 10.0),), seed=2),
    Scenario("one", (Wanted("pressure_gain", 10.0),), seed=3),
    Scenario("one", (Wanted("radiation_loss", 10.0),), seed=4),
)
DONE: list[str] = []
EARLIER: list[Mapping[str, Outcome]] = []


def work(scenario: Scenario, earlier: Mapping[str, Outcome] | None = None) -> Outcome:
    DONE.append(scenario.name)
    EARLIER.append(earlier or {})
    if not scenario.hidden:
        return Outcome(scenario, verdict="adequate")
    if scenario.truth == ("radiation_loss",):
        return Outcome(scenario, untested="no amplitude of radiation_loss has the size wanted")
    named = scenario.truth if scenario.truth == ("valve_leakage",) else ("pump_slip",)
    return Outcome(
        scenario, verdict="missing_effect", effects=named, first=named[0], rival_cosine=0.5, separation=5.0
    )


@pytest.fixture(autouse=True)
def short(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("rigctl_validation.tiers.scenarios", lambda tier: SCENARIOS)
    monkeypatch.setattr("rigctl_validation.work.carry_out", work)
    monkeypatch.chdir(tmp_path)
    DONE.clear()
    EARLIER.clear()


def told(*arguments: str) -> str:
    result = CliRunner().invoke(app, ["validate", "--workers", "1", *arguments], catch_exceptions=False)
    assert result.exit_code == 0
    return result.stdout


def test_rates_are_printed_with_their_targets_and_the_mistaken_effects() -> None:
    printed = told()
    assert "accepted and wrong" in printed
    assert "at most 1.0 %: missed" in printed
    assert "pump_slip 1" in printed
    assert "1 trial could not be made" in printed
    page = Path("validation/quick.md").read_text(encoding="utf-8")
    assert page.startswith("`rigctl validate --tier quick`: 3 trials")
    assert "| pressure_gain | 0 of 1 | pump_slip 1 |" in page


def test_the_json_document_has_rates_confusion_and_the_results_file() -> None:
    found = json.loads(told("--json", "--out", "kept"))
    assert found["scenarios"] == 4
    assert found["confusion"]["valve_leakage"] == {"valve_leakage": 1}
    rates = {(rate["name"], rate["of"]): rate for rate in found["rates"]}
    assert rates["false alarm, nothing hidden", "noise estimated"]["met"] is True
    assert Path(found["results"]).is_file()


def test_a_validation_reuses_what_does_not_depend_on_the_method() -> None:
    told("--out", "kept")
    told("--out", "again", "--reuse", "kept/quick.jsonl")
    assert EARLIER[: len(SCENARIOS)] == [{}] * len(SCENARIOS)
    assert len(EARLIER) == 2 * len(SCENARIOS)
    for earlier in EARLIER[len(SCENARIOS) :]:
        assert {name: outcome.scenario for name, outcome in earlier.items()} == {
            scenario.name: scenario for scenario in SCENARIOS
        }


def test_results_are_reused_only_where_there_are_any() -> None:
    Path("empty.jsonl").write_text("", encoding="utf-8")
    with pytest.raises(RigctlError, match="no results of the tier quick"):
        told("--reuse", "empty.jsonl")
    with pytest.raises(RigctlError, match="no such file"):
        told("--reuse", "kept/quick.jsonl")
    with pytest.raises(RigctlError, match="nothing that could be reused"):
        told("--tier", "design", "--reuse", "kept/quick.jsonl")


def test_a_validation_continues_only_with_resume_and_runs_no_trial_twice() -> None:
    told("--first", "2")
    assert len(DONE) == 2
    with pytest.raises(RigctlError, match="there already"):
        told()
    told("--resume")
    assert sorted(DONE) == sorted(scenario.name for scenario in SCENARIOS)


def test_ctrl_c_prints_what_is_kept_and_how_to_continue(monkeypatch: pytest.MonkeyPatch) -> None:
    def stopped(scenario: Scenario) -> Outcome:
        if DONE:
            raise KeyboardInterrupt
        return work(scenario)

    monkeypatch.setattr("rigctl_validation.work.carry_out", stopped)
    with pytest.raises(RigctlError, match="every finished trial is kept, and '--resume' continues") as end:
        told("--tier", "quick")
    assert end.value.exit_code == ExitCode.INTERRUPTED
    assert len(Path("validation/quick.jsonl").read_text("utf-8").splitlines()) == 1


def test_the_tier_of_other_benches_is_run_and_reported_alike(monkeypatch: pytest.MonkeyPatch) -> None:
    def say_adequate(trial: BenchTrial) -> TrialOutcome[BenchTrial]:
        return TrialOutcome(trial, verdict="adequate")

    monkeypatch.setattr("rigctl_validation.small_benches.work.carry_out_trial", say_adequate)
    found = json.loads(told("--tier", "anyone", "--first", "20", "--json"))
    rates = {(rate["name"], rate["of"]): rate for rate in found["rates"]}
    assert rates["false alarm", "nothing hidden"]["count"] == 0
    assert rates["right, or its class", "λ >= 30"]["met"] is False
    assert found["confusion"]["motor"] == {"adequate": 1}
    assert json.loads(told("--tier", "anyone", "--first", "20", "--resume", "--json")) == found
    assert (
        Path("validation/anyone.md")
        .read_text(encoding="utf-8")
        .startswith("`rigctl validate --tier anyone --first 20`: 20 trials")
    )


def test_without_its_distribution_one_message_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    entry = BY_NAME["validate"]._replace(package="rigctl_elsewhere")
    monkeypatch.setitem(BY_NAME, "validate", entry)
    said = refusal("validate", "--tier", "quick")
    assert "a package of its own, which is not installed" in said
    assert "pip install . ./rigctl-elsewhere; with pipx: pipx inject rigctl ./rigctl-elsewhere" in said
