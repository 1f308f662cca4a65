"""The tier of several devices: what they read, what the rig file says of them, and the answers."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rigctl.engine.one_thread import one_thread
from rigctl.rig.load import load_rig
from rigctl_validation.bench.campaign import Campaign, simulate_records
from rigctl_validation.bench.devices import Device, simulate_on_devices
from rigctl_validation.bench.sensing import CHANNELS, Noise
from rigctl_validation.devices.rates import answer, devices_figures
from rigctl_validation.devices.trial import DEVICES, DevicesTrial, devices_trials
from rigctl_validation.devices.work import diagnose_devices
from rigctl_validation.outcome import TrialOutcome
from rigctl_validation.scenario import Scenario

#: N: that of the tier, found once
FRICTION = 109.57
QUIET = Campaign(
    temperatures=(40.0,), pressures=(30.0,), noise=Noise(sigma=dict.fromkeys(CHANNELS, 0.0)), seed=3
)


def test_each_device_reads_at_its_own_times() -> None:
    (split,) = simulate_on_devices(QUIET, tuple(DEVICES))
    for device in DEVICES:
        for name in set(device.channels) & split.channels.keys():
            times = split.time[np.isfinite(split.channels[name])]
            assert times[0] == pytest.approx(device.phase)
            assert np.diff(times) == pytest.approx(1.0 / device.rate)
    rows = np.column_stack(list(split.channels.values()))
    assert np.isfinite(rows).any(axis=1).all()
    assert np.isnan(rows).any(axis=1).sum() > 100


def test_a_reading_is_what_was_there_as_long_before_as_the_device_is_late() -> None:
    late = Device("late", tuple(CHANNELS), rate=100.0, age=0.06)
    (read,), (exact,) = simulate_on_devices(QUIET, [late]), simulate_records(QUIET)
    for name, values in exact.channels.items():
        assert read.channels[name][6:] == pytest.approx(values[:-6], rel=1e-3, abs=1e-5)
    assert np.array_equal(read.command, exact.command)


def test_the_run_says_how_old_the_readings_of_each_device_are(tmp_path: Path) -> None:
    trial = DevicesTrial(
        Scenario("nothing", temperatures=(20.0, 80.0), pressures=(50.0,), repeated=1), "several"
    )
    with one_thread():
        found = diagnose_devices(trial, trial.scenario.campaign(()), tmp_path)
    clocks = load_rig(tmp_path / "rig.yaml").clocks
    for device, uncertainty in DEVICES.items():
        if clock := clocks.get(device.name):
            assert clock.uncertainty == pytest.approx(uncertainty)
            assert abs(clock.offset + device.age) <= uncertainty
    assert clocks.keys() == {"daq", "plant", "meter"}
    assert found.verdict.value == "adequate"


def test_the_tier_compares_the_readings_of_every_campaign() -> None:
    trials = devices_trials()
    assert len({trial.name for trial in trials}) == len(trials)
    assert [trial.reading for trial in trials[:6]] == 2 * ["one", "several", "shifted"]
    assert {trial.truth for trial in trials[:6]} == {("coulomb_friction",), ()}
    assert all(DevicesTrial.read(json.loads(json.dumps(one.document()))) == one for one in trials)


def test_rates_count_equal_answers_and_effects_that_are_not_there() -> None:
    hidden, nothing = devices_trials()[:3], devices_trials()[3:6]
    friction = (("coulomb_friction", "stribeck_friction"),)
    outcomes = [
        TrialOutcome(hidden[0], "ambiguous", ("coulomb_friction",), friction),
        TrialOutcome(hidden[1], "ambiguous", ("stribeck_friction",), friction),
        TrialOutcome(hidden[2], "missing_effect", ("valve_open_delay",)),
        TrialOutcome(nothing[0], "adequate"),
        TrialOutcome(nothing[1], "missing_effect", ("spring_load",)),
        TrialOutcome(nothing[2], "adequate", explained_by="clock"),
    ]
    assert answer(outcomes[0]) == answer(outcomes[1]), "the same class"
    assert answer(outcomes[0]) != answer(replace(outcomes[1], classes=()))
    figures = devices_figures(outcomes)
    rates = {(rate.name, rate.of): (rate.count, rate.trials) for rate in figures.rates}
    assert rates["same verdict", "several devices and one"] == (1, 2)
    assert rates["same verdict and effects", "several devices and one"] == (1, 2)
    assert rates["wrong name", "hidden, one of several 12 ms too old"] == (1, 1)
    assert rates["an effect is named", "nothing hidden, several devices"] == (1, 1)
    assert rates["explained by a clock", "nothing hidden, one of several 12 ms too old"] == (1, 1)
    assert figures.listing[2][1:] == ("several devices", "ambiguous: coulomb_friction or stribeck_friction")
    json.dumps(figures.document(), allow_nan=False)


@pytest.mark.parametrize("reading", ["one", "several", "shifted"])
def test_a_hidden_friction_is_found_however_the_bench_is_read(reading: str, tmp_path: Path) -> None:
    trial = next(
        one for one in devices_trials() if one.truth == ("coulomb_friction",) and one.reading == reading
    )
    with one_thread():
        found = diagnose_devices(trial, trial.scenario.campaign((FRICTION,)), tmp_path)
    assert found.verdict.value == "ambiguous"
    assert (found.effects, found.classes) == (
        ("coulomb_friction",),
        (("coulomb_friction", "stribeck_friction"),),
    )
