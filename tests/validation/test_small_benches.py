"""The generators of the small benches: they agree with analytical solutions and are reproducible."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rigctl.errors import RigctlError
from rigctl_validation.benches.__main__ import main
from rigctl_validation.benches.bench import BenchCampaign
from rigctl_validation.benches.motion import integrate, with_dry_friction
from rigctl_validation.benches.register import BENCHES, find_bench
from rigctl_validation.benches.size import size_of
from rigctl_validation.outcome import TrialOutcome, Verdict
from rigctl_validation.small_benches.rates import bench_figures
from rigctl_validation.small_benches.tier import SIZES, bench_trials
from rigctl_validation.small_benches.trial import BenchTrial
from rigctl_validation.small_benches.work import amplitude_of, carry_out_trial


def test_dry_friction_brings_a_sliding_mass_to_rest_and_holds_it() -> None:
    time = np.linspace(0.0, 3.0, 61)
    states = with_dry_friction(lambda t, y: (y[1], 0.0), (0.0, 2.0), time, (), velocity=1, friction=1.0)
    until = np.minimum(time, 2.0)
    assert states[:, 1] == pytest.approx(2.0 - until, abs=1e-6)
    assert states[:, 0] == pytest.approx(2.0 * until - until**2 / 2, abs=1e-6)


def test_dry_friction_reduces_free_swings_linearly() -> None:
    """Free swings of x'' = −w²·x − f·sign(v) shrink by 4·f/w² a period and end within f/w²."""
    square, friction = 100.0, 1.0
    time = np.arange(0, 6) * np.pi / np.sqrt(square)
    states = with_dry_friction(
        lambda t, y: (y[1], -square * y[0]), (0.1, 0.0), time, (), velocity=1, friction=friction
    )
    assert np.abs(states[:, 0]) == pytest.approx([0.1, 0.08, 0.06, 0.04, 0.02, 0.0], abs=1e-5)


def test_a_switch_between_samples_acts_at_its_exact_time() -> None:
    time = np.linspace(0.0, 1.0, 11)
    states = integrate(lambda t, y: (1.0 if t >= 0.333 else 0.0,), (0.0,), time, (0.333,))
    assert states[:, 0] == pytest.approx(np.maximum(time - 0.333, 0.0), abs=1e-8)


@pytest.mark.parametrize("name", list(BENCHES))
def test_equal_seeds_give_equal_files_and_noise_has_the_stated_size(name: str, tmp_path: Path) -> None:
    bench = find_bench(name)
    campaign = BenchCampaign(bench, bench.hidden.typical, "five", seed=3)
    paths = [tmp_path / f"{which}.csv" for which in "ab"]
    for path in paths:
        campaign.write_csv(path)
    assert paths[0].read_bytes() == paths[1].read_bytes()
    replace(campaign, recorded=False).write_csv(paths[1])
    headings = [path.read_text(encoding="utf-8").splitlines()[0] for path in paths]
    assert bench.optional in headings[0]
    assert bench.optional not in headings[1]
    for channel, sigma in bench.noise.items():
        noisy = np.concatenate([record.columns[channel] for record in campaign.records()])
        truth = np.concatenate([trace.columns[channel] for trace in campaign.traces()])
        assert np.std(noisy - truth) == pytest.approx(sigma, rel=0.35)


@pytest.mark.parametrize("name", ["tanks", "chain", "pump"])
def test_the_amplitude_found_has_the_requested_size(name: str) -> None:
    amplitude, size = amplitude_of(BenchTrial(name, 30.0, "five"))
    assert size == pytest.approx(30.0, rel=0.05)
    campaign = BenchTrial(name, 30.0, "five").campaign(amplitude)
    assert size_of(campaign) == pytest.approx(size)
    assert size_of(replace(campaign, amplitude=0.0)) == 0.0
    assert size_of(replace(campaign, amplitude=2.0 * amplitude)) > 1.3 * size


def test_an_unknown_bench_is_refused_with_the_nearest_name() -> None:
    with pytest.raises(RigctlError, match="motor"):
        find_bench("motro")


def test_every_round_of_the_tier_has_every_bench_with_and_without_a_hidden_effect() -> None:
    trials = bench_trials()
    assert len({trial.name for trial in trials}) == len(trials)
    for begin in range(0, len(trials), 2 * len(BENCHES)):
        part = trials[begin : begin + 2 * len(BENCHES)]
        assert {(t.bench, bool(t.size)) for t in part} == {(n, h) for n in BENCHES for h in (False, True)}
    first = trials[:200]
    assert {t.size for t in first} == {0.0, *SIZES}
    for field, values in (("noise", 3), ("sampling", 3), ("recorded", 2)):
        assert len({getattr(t, field) for t in first if t.size}) == values


def outcome(size: float, verdict: Verdict, *effects: str) -> TrialOutcome[BenchTrial]:
    return TrialOutcome(BenchTrial("motor", size), verdict=verdict, effects=effects)


def test_rates_and_confusion_of_small_benches_are_counted_correctly() -> None:
    right = BENCHES["motor"].hidden.counts_as[0]
    found = bench_figures(
        [
            outcome(0.0, "adequate"),
            outcome(0.0, "missing_effect", "gain"),
            outcome(30.0, "missing_effect", right),
            outcome(30.0, "missing_effect", "gain"),
            outcome(30.0, "outside_library"),
            TrialOutcome(BenchTrial("motor", 30.0), failure="no convergence"),
            TrialOutcome(BenchTrial("motor", 30.0), untested="no amplitude has the size wanted"),
        ]
    )
    counted = {(rate.name, rate.of): (rate.count, rate.trials) for rate in found.rates}
    assert counted["false alarm", "nothing hidden"] == (1, 2)
    assert counted["right, or its class", "λ >= 30"] == (1, 4)
    assert counted["wrong", "all trials"] == (2, 6)
    assert counted["failed", "all trials"] == (1, 6)
    assert found.confusion == {"motor": {"motor": 1, "gain": 1, "outside_library": 1, "failed": 1}}
    json.dumps(found.document(), allow_nan=False)


def test_a_trial_survives_json() -> None:
    trial = BenchTrial("belt", 30.0, "slow", recorded=False, noise="level", seed=7)
    assert BenchTrial.read(json.loads(json.dumps(trial.document()))) == trial
    assert trial.name == "belt 30 slow unrecorded level seed 7"


def test_the_command_writes_a_project_and_reports_the_size_of_the_hidden_effect(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "mine"
    assert main(["chain", "--hide", "0.089", "--sampling", "slow", "--unrecorded", "-o", str(folder)]) == 0
    assert {path.name for path in folder.iterdir()} == {"family.yaml", "rig.yaml", "model.yaml", "chain.csv"}
    assert "room" not in (folder / "chain.csv").read_text(encoding="utf-8").splitlines()[0]
    assert 80.0 < float(capsys.readouterr().out.split("lambda = ")[1]) < 120.0


def test_spikes_during_motion_are_not_taken_for_missing_physics() -> None:
    outcome = carry_out_trial(BenchTrial("spring", 0.0, "slow", recorded=False, noise="heavy", seed=0))
    assert outcome.verdict == "adequate"
