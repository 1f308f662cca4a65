"""Stored results survive a kill, and an interrupted benchmark resumes."""

from __future__ import annotations

from pathlib import Path

import pytest

from rigctl.errors import RigctlError
from rigctl.tasks import Workers
from rigctl_validation.outcome import Outcome
from rigctl_validation.parallel import BenchmarkProgress, run_scenarios
from rigctl_validation.scenario import Scenario
from rigctl_validation.store import ResultStore
from validation_work import dying, quick

SCENARIOS = [Scenario("nothing", seed=seed) for seed in range(8)]


def test_a_truncated_result_is_computed_again(tmp_path: Path) -> None:
    store = ResultStore(tmp_path / "kept" / "results.jsonl", "1", Scenario.read)
    for scenario in SCENARIOS[:3]:
        store.keep(Outcome(scenario, verdict="adequate"))
    whole = store.path.read_bytes()
    store.path.write_bytes(whole[:-40])
    assert [s.seed for s in store.missing(SCENARIOS)] == [2, 3, 4, 5, 6, 7]
    store.keep(Outcome(SCENARIOS[2], verdict="ambiguous"))
    assert [outcome.verdict for outcome in store.outcomes()] == ["adequate", "adequate", "ambiguous"]


def test_results_of_another_version_are_ignored(tmp_path: Path) -> None:
    path = tmp_path / "results.jsonl"
    ResultStore(path, "1", Scenario.read).keep(Outcome(SCENARIOS[0], verdict="adequate"))
    assert len(ResultStore(path, "2", Scenario.read).missing(SCENARIOS)) == len(SCENARIOS)
    assert ResultStore(path, "2", Scenario.read).outcomes() == ()


def test_the_last_result_of_a_scenario_counts(tmp_path: Path) -> None:
    store = ResultStore(tmp_path / "results.jsonl", "1", Scenario.read)
    for verdict in ("adequate", "ambiguous"):
        store.keep(Outcome(SCENARIOS[0], verdict=verdict))
    assert [outcome.verdict for outcome in store.outcomes(SCENARIOS)] == ["ambiguous"]


def test_an_unwritable_store_is_reported(tmp_path: Path) -> None:
    with pytest.raises(RigctlError, match="cannot keep the result"):
        ResultStore(tmp_path, "1", Scenario.read).keep(Outcome(SCENARIOS[0]))


@pytest.mark.parametrize("workers", [1, 2])
def test_a_resumed_run_computes_only_the_missing_results(tmp_path: Path, workers: int) -> None:
    store = ResultStore(tmp_path / "results.jsonl", "1", Scenario.read)
    first = run_scenarios(SCENARIOS[:4], quick, store, workers=Workers(workers))
    assert {outcome.scenario.seed: bool(outcome.failure) for outcome in first} == {
        0: False, 1: True, 2: False, 3: True,
    }  # fmt: skip
    seen: list[BenchmarkProgress] = []
    found = run_scenarios(SCENARIOS, quick, store, workers=Workers(workers), progress=seen.append)
    assert len(found) == 8
    assert len(store.path.read_text(encoding="utf-8").splitlines()) == 8
    assert [standing.done for standing in seen] == [4, 5, 6, 7, 8]
    assert seen[-1].left == 0.0
    assert seen[-1].failed == 2
    assert str(seen[-1]).startswith("Trials: 8 of 8, 2 failed")


def test_a_killed_process_loses_only_the_trial_in_progress(tmp_path: Path) -> None:
    store = ResultStore(tmp_path / "results.jsonl", "1", Scenario.read)
    with pytest.raises(RigctlError, match="was killed"):
        run_scenarios(SCENARIOS, dying, store, workers=Workers(2))
    kept = len(store.outcomes())
    assert kept < 8
    assert len(run_scenarios(SCENARIOS, quick, store, workers=Workers(1))) == 8
