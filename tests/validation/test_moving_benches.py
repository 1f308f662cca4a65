"""The moving twins: their generator, the trials of their tier, and how the answers are counted."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rigctl.effects.generic.offer import generic_effects
from rigctl.errors import RigctlError
from rigctl.physics.user.load import load_family
from rigctl.rig.load import load_rig
from rigctl_validation.benches.motion import with_dry_friction
from rigctl_validation.moving.rates import moving_figures
from rigctl_validation.moving.spoiled import write_spoiled
from rigctl_validation.moving.tier import moving_trials
from rigctl_validation.moving.trial import MovingTrial
from rigctl_validation.moving.work import MovingOutcome, carry_out_moving
from rigctl_validation.moving_benches.campaign import MovingCampaign, write_moving
from rigctl_validation.moving_benches.excitation import MOTIONS
from rigctl_validation.moving_benches.left_over import amplitude_leaving, left_over
from rigctl_validation.moving_benches.register import TWINS, find_twin
from rigctl_validation.moving_benches.slow_noise import COLOURS, Colour, noise_series
from rigctl_validation.outcome import Interval, TrialOutcome, Verdict

SPRING = TWINS["spring"]
DRY = SPRING.find("dry friction")


@pytest.mark.parametrize("friction", [0.0, 0.3, 1.5])
def test_sticking_and_sliding_agree_with_an_integration_by_events(friction: float) -> None:
    campaign = MovingCampaign(SPRING, "prbs", DRY, seed=3)
    samples, period = campaign.size
    drive, push = 1e-3 * campaign.inputs[:, 0], campaign.inputs[:, 1]
    time = np.arange(samples) * period
    stiffness, damping = campaign.drawn

    def rates(t: float, y: np.ndarray) -> tuple[float, float]:
        now = drive[min(int(t / period + 1e-9), samples - 1)]
        force = stiffness * (now - y[0]) - damping * y[1] + np.interp(t, time, push)
        return float(y[1]), float(force / 1.5)

    breaks = [float(time[i]) for i in range(1, samples) if drive[i] != drive[i - 1]]
    states = with_dry_friction(rates, (0.0, 0.0), time[:80], breaks, velocity=1, friction=friction / 1.5)
    position = campaign.readings(friction)["position"][:80]
    assert position == pytest.approx(1e3 * states[:, 0], abs=1e-3)


@pytest.mark.parametrize("name", list(TWINS))
def test_no_twin_ever_rests_and_each_stays_within_its_limits(name: str) -> None:
    twin = find_twin(name)
    for motion in MOTIONS:
        if motion == "decay" and not twin.decay:
            continue
        campaign = MovingCampaign(twin, motion, seed=1)
        readings = campaign.readings(0.0)
        moved = np.zeros(10)
        for channel, sigma in twin.bench.noise.items():
            assert np.abs(readings[channel]).max() <= twin.limits.get(channel, np.inf)
            tenths = np.array_split(readings[channel], 10)
            moved = np.maximum(moved, [np.ptp(tenth) / sigma for tenth in tenths])
        assert moved.min() > 1.0


@pytest.mark.parametrize("name", list(TWINS))
def test_the_right_answers_are_effects_of_the_users_family(name: str) -> None:
    twin = find_twin(name)
    effects = {effect.name: effect for effect in generic_effects(load_family(twin.bench.file("family.yaml")))}
    for hidden in twin.hidden:
        assert set(hidden.counts_as) <= effects.keys()
        if hidden.exact is not None:
            effect, parameter = hidden.exact
            assert parameter in {each.name for each in effects[effect].parameters}


@pytest.mark.parametrize("colour", COLOURS)
def test_noise_has_its_white_and_its_slow_part(colour: Colour) -> None:
    series = noise_series(
        colour, 20_000, 0.0 if colour in ("white", "heavy") else 2.0, np.random.default_rng(0)
    )
    slow = 0.0 if colour in ("white", "heavy") else 2.0
    assert series.std() == pytest.approx(np.hypot(1.0, slow), rel=0.2)
    neighbours = np.corrcoef(series[1:], series[:-1])[0, 1]
    assert (neighbours > 0.2) == bool(slow)


def test_equal_seeds_give_equal_files_and_the_rig_file_states_the_noise(tmp_path: Path) -> None:
    campaign = MovingCampaign(TWINS["chain"], "multisine", colour="ar", statement="stated", seed=5)
    logs = [write_moving(campaign, [campaign.table(0.0)], tmp_path / which).read_bytes() for which in "ab"]
    assert logs[0] == logs[1]
    rig = load_rig(tmp_path / "a" / "rig.yaml")
    for channel in campaign.twin.bench.noise:
        measured = campaign.noise()[channel].std()
        assert rig.channels[channel].noise == pytest.approx(measured, rel=0.6)
    wrong = replace(campaign, statement="too large").rig_text()
    assert load_rig(_written(tmp_path / "wrong.yaml", wrong)).channels["hot"].noise == pytest.approx(
        5.0 * campaign.total("hot"), rel=1e-3
    )


def _written(path: Path, text: str) -> Path:
    path.write_text(text.replace("model: family.yaml\n", ""), encoding="utf-8")
    return path


def test_the_amplitude_leaves_what_was_wanted_after_the_best_fit_without_the_effect() -> None:
    campaign = MovingCampaign(SPRING, "multisine", DRY, seed=2)
    amplitude, left = amplitude_leaving(campaign, 8.0)
    assert left == pytest.approx(8.0, rel=0.05)
    assert left_over(campaign, amplitude)["position"] == pytest.approx(left)
    assert left_over(campaign, 0.0)["position"] < 1e-3


def test_the_tier_has_every_colour_statement_and_motion_and_its_beginning_is_a_sample() -> None:
    trials = moving_trials()
    sound = [trial for trial in trials if not trial.spoiled]
    assert len({trial.name for trial in trials}) == len(trials)
    assert len(sound) >= 500
    assert sum(bool(trial.hidden) for trial in sound) * 2 == len(sound)
    for field, values in (("colour", 5), ("statement", 4), ("motion", 4), ("bench", len(TWINS))):
        assert len({getattr(trial, field) for trial in trials[:200]}) == values
    wrongly = [trial.statement for trial in sound if trial.statement.startswith("too")]
    assert 0.4 < wrongly.count("too large") / len(wrongly) < 0.6
    assert all(MovingTrial.read(json.loads(json.dumps(t.document()))) == t for t in trials[:50])


def outcome(
    verdict: Verdict, *effects: str, hidden: str = "dry friction", colour: Colour = "white", **more: object
) -> MovingOutcome:
    trial = MovingTrial("spring", "prbs", hidden, colour)
    return replace(TrialOutcome(trial, verdict=verdict, effects=effects), **more)


def counts(outcomes: Iterable[MovingOutcome]) -> dict[tuple[str, str], tuple[int, int]]:
    found = moving_figures(tuple(outcomes))
    json.dumps(found.document(), allow_nan=False)
    return {(rate.name, rate.of): (rate.count, rate.trials) for rate in found.rates}


def test_answers_on_a_twin_that_hides_something_are_counted() -> None:
    right, other = "coulomb_on_velocity", "gain_of_drive"
    found = counts([
        outcome("missing_effect", right),
        outcome("ambiguous", other, classes=((other, right),)),
        outcome("missing_effect", other),
        outcome("missing_effect", right, other),
        outcome("adequate"),
        outcome("undecided"),
        outcome("outside_library"),
        outcome("adequate", untested="no amplitude has the size wanted"),
    ])  # fmt: skip
    assert found["right, or its class", "hidden, noise unstated"] == (2, 7)
    assert found["wrong name", "hidden, noise unstated"] == (2, 7)
    assert found["wrong green", "hidden, noise unstated"] == (1, 7)
    assert found["not decided", "hidden, noise unstated"] == (1, 7)
    assert found["something is missing, not what", "hidden, noise unstated"] == (1, 7)


def test_not_decided_is_no_alarm_and_drifting_noise_may_be_called_a_drift() -> None:
    drift = "drift_of_position"
    found = counts([
        outcome("adequate", hidden=""),
        outcome("undecided", hidden=""),
        outcome("outside_library", hidden=""),
        outcome("missing_effect", drift, hidden=""),
        outcome("missing_effect", drift, hidden="", colour="drift"),
        TrialOutcome(MovingTrial("spring", "prbs"), failure="no convergence"),
    ])  # fmt: skip
    assert found["false alarm", "nothing hidden, noise unstated"] == (3, 6)
    assert found["not decided", "nothing hidden, noise unstated"] == (1, 6)
    assert found["false alarm", "drift noise, unstated"] == (0, 1)


def test_coverage_is_counted_for_sizes_and_for_the_benchs_own_values() -> None:
    size = Interval("coulomb_on_velocity", "size", 1.0, 0.9, 1.1)
    own = Interval("", "stiffness", 600.0, 601.0, 602.0)
    found = counts([
        outcome("missing_effect", "coulomb_on_velocity", intervals=(size,)),
        outcome("adequate", hidden="", intervals=(own, own)),
    ])  # fmt: skip
    name = "95 % interval covers the truth"
    assert found[name, "size of the hidden effect"] == (1, 1)
    assert found[name, "values of the bench, nothing hidden"] == (0, 2)


def test_a_spoiled_log_may_not_get_a_verdict() -> None:
    def spoiled(verdict: Verdict, kind: str) -> MovingOutcome:
        trial = replace(MovingTrial("spring", "prbs"), spoiled=kind)
        return TrialOutcome(trial, verdict=verdict)

    coarse = "converter steps of five sigmas, 28 records"
    found = counts([
        spoiled("refused", "twelve rows"),
        spoiled("undecided", "twelve rows"),
        spoiled("adequate", "twelve rows"),
        spoiled("adequate", coarse),
        spoiled("outside_library", coarse),
    ])  # fmt: skip
    assert found["a verdict for a spoiled log", "all kinds"] == (2, 5)
    assert found["a verdict for a spoiled log", "twelve rows"] == (1, 3)


def test_a_noise_stated_in_another_quantity_is_refused(tmp_path: Path) -> None:
    campaign = MovingCampaign(SPRING, "prbs", seed=1)
    write_spoiled(campaign, "a stated noise in another quantity", tmp_path)
    with pytest.raises(RigctlError, match="noise"):
        load_rig(tmp_path / "rig.yaml")


def test_spoiled_logs_are_what_their_names_say(tmp_path: Path) -> None:
    campaign = MovingCampaign(SPRING, "multisine", seed=1)
    rows = {}
    for kind in (
        "a reading that is constant",
        "a reading of two values",
        "twelve rows",
        "blocks of missing values",
    ):
        log = write_spoiled(campaign, kind, tmp_path / kind)
        rows[kind] = [line.split(",")[-1] for line in log.read_text(encoding="utf-8").splitlines()[1:]]
    assert len(set(rows["a reading that is constant"])) == 1
    assert len(set(rows["a reading of two values"])) == 2
    assert len(rows["twelve rows"]) == 12
    assert 0.3 < rows["blocks of missing values"].count("") / len(rows["blocks of missing values"]) < 0.6


def test_one_trial_runs_from_the_generator_to_the_verdict() -> None:
    done = carry_out_moving(MovingTrial("belt", "prbs", seed=2, statement="stated"))
    assert done.verdict is not None
    assert not done.failure
    assert {interval.parameter for interval in done.intervals} <= {"lag", "radius"}
