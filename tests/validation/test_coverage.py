"""The tier of coverage: sensors and guesses wrong by what is stated of them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rigctl.model.load import load_model
from rigctl.rig.load import load_rig
from rigctl_validation.coverage.misread import KINDS, WRITTEN, Kind, Written
from rigctl_validation.coverage.rates import coverage_rates
from rigctl_validation.coverage.trial import CoverageTrial, coverage_trials
from rigctl_validation.coverage.work import carry_out_coverage
from rigctl_validation.moving_benches.campaign import write_moving
from rigctl_validation.outcome import Interval, TrialOutcome

TRIAL = CoverageTrial("motor", "prbs", kind="line", assumed=True, seed=50_048)


def test_the_tier_has_a_thousand_trials_and_its_beginning_is_a_sample() -> None:
    trials = coverage_trials()
    assert len(trials) >= 1000
    assert len({trial.name for trial in trials}) == len(trials)
    assert 2 * sum(bool(trial.hidden) for trial in trials) == len(trials)
    for field, values in (("kind", 3), ("written", 3), ("assumed", 2), ("motion", 4), ("bench", 10)):
        assert len({getattr(trial, field) for trial in trials[:150]}) == values
    assert all(CoverageTrial.read(json.loads(json.dumps(t.document()))) == t for t in trials[:50])


@pytest.mark.parametrize("written", WRITTEN)
def test_sensors_are_as_wrong_as_the_rig_file_says(written: Written) -> None:
    """Over many seeds the errors have half of the stated 95 % as standard deviation."""
    kind: Kind = "point" if written == "parts" else "data_sheet"
    shares = []
    for seed in range(60):
        misread = replace(TRIAL, written=written, kind=kind, seed=seed).misread
        table = misread.campaign.table(0.0)
        read = misread.read(table)
        assert np.array_equal(read["voltage"], table["voltage"])
        for name, stated in misread.stated.items():
            error = (read[name] - table[name]) / stated
            shares.append(error[int(np.argmax(np.abs(error)))])
    # the largest error of a channel; where a parabola is not the largest at an end, it is smaller
    assert 0.4 < np.std(shares) < 0.65


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("written", WRITTEN)
def test_the_files_state_it(tmp_path: Path, kind: Kind, written: Written) -> None:
    misread = replace(TRIAL, written=written, kind=kind).misread
    write_moving(misread.campaign, [misread.campaign.table(0.0)], tmp_path)
    misread.state(tmp_path)
    rig = load_rig(tmp_path / "rig.yaml")
    truth = misread.campaign.readings(0.0)
    for name, stated in misread.stated.items():
        half = 0.5 * float(np.ptp(truth[name]))
        known = rig.channels[name].reading_uncertainty(0.0, half)
        count = 3 if written == "uncertainty" else 1 + KINDS.index(kind)
        assert sum(size > 0.0 for size in known.values()) == count
        assert known["zero"] == pytest.approx(stated)
    model, twin = load_model(tmp_path / "model.yaml"), misread.campaign.twin
    assert misread.guess in {each.parameter for each in misread.campaign.twin.drawn}
    assert misread.guess not in model.fitted
    low, high = model.assumed[misread.guess]
    drawn = {
        each.parameter: each.si * value
        for each, value in zip(twin.drawn, misread.campaign.drawn, strict=True)
    }
    assert low < drawn[misread.guess] < high


def test_a_trial_is_answered_from_its_files() -> None:
    outcome = carry_out_coverage(TRIAL)
    assert outcome.verdict == "adequate"
    assert TrialOutcome.read(json.loads(json.dumps(outcome.document())), CoverageTrial.read) == outcome
    assert {one.parameter for one in outcome.intervals} >= {"resistance", "inertia"}


def test_the_rates_count_intervals_alarms_and_what_sensors_explain() -> None:
    inside, outside = Interval("", "inertia", 1.0, 0.9, 1.1), Interval("", "inertia", 1.0, 1.1, 1.2)
    hidden = replace(TRIAL, hidden="dry friction")
    outcomes = [
        TrialOutcome(TRIAL, verdict="adequate", intervals=(inside, inside, outside)),
        TrialOutcome(TRIAL, verdict="outside_library", explained_by="calibration"),
        TrialOutcome(hidden, verdict="ambiguous", effects=("coulomb_on_torque",)),
        TrialOutcome(hidden, verdict="adequate", explained_by="calibration"),
        TrialOutcome(hidden, verdict="adequate"),
    ]
    rates = {(rate.name, rate.of): (rate.count, rate.trials) for rate in coverage_rates(outcomes)}
    values = "values of the bench, nothing hidden, parts stated"
    assert rates["95 % interval covers the truth", values] == (2, 3)
    assert rates["an effect is said to be missing", "nothing hidden"] == (0, 2)
    assert rates["a sensor is said to be wrong by more", "nothing hidden"] == (1, 2)
    assert rates["adequate", "nothing hidden"] == (1, 2)
    assert rates["right, or its class", "hidden"] == (1, 3)
    assert rates["explained by the stated calibrations", "hidden"] == (1, 3)
    assert rates["adequate without a word of sensors", "hidden"] == (1, 3)


@pytest.mark.parametrize(
    ("seed", "verdict", "explained"),
    [(50046, "undecided", ""), (51162, "outside_library", "calibration")],
    ids=["a zero that imitates a torque", "a voltmeter beyond its calibration"],
)
def test_an_error_of_a_plain_uncertainty_is_no_missing_effect(
    seed: int, verdict: str, explained: str
) -> None:
    """Both were said to lack an effect, in the scale of their own errors, with sensors taken for exact."""
    trial = next(one for one in coverage_trials() if one.seed == seed)
    outcome = carry_out_coverage(trial)
    assert trial.hidden == ""
    assert (outcome.verdict, outcome.explained_by, outcome.effects) == (verdict, explained, ())
