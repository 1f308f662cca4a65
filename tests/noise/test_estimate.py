"""Sigma and correlation are recovered from data of the separate bench, which shares no code with rigctl."""

from __future__ import annotations

import warnings
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from rigctl.noise import NoiseModel, NoiseRecord, estimate_noise
from rigctl_validation.bench.sensing import TEN_BITS, Noise

NAMES = ("oil_temperature", "supply_pressure", "position", "pressure_a", "pressure_b")
SIGMA = np.array([Noise().sigma[name] for name in NAMES])
STEP = np.array([TEN_BITS[name] for name in NAMES])
#: the rod at rest after the stroke; in motion; both
STRETCHES = ((165, 225), (60, 120), (30, 125))


def coloured(rng: np.random.Generator, size: int, rho: float) -> NDArray[np.float64]:
    drive = rng.standard_normal(size)
    drive[1:] *= np.sqrt(1.0 - rho**2)
    return np.asarray(lfilter([1.0], [1.0, -rho], drive))


def stretch_means(bench_truth, records: list[NoiseRecord], noise: NoiseModel) -> NDArray[np.float64]:
    """Mean errors over stretches, divided by their standard deviation according to the noise model."""
    found = []
    for first, last in STRETCHES:
        times = np.arange(last - first) * noise.spacing
        std = np.sqrt([channel.covariance(times, noise.spacing).mean() for channel in noise.channels])
        for record, truth in zip(records, bench_truth.records, strict=True):
            found.append((record.values[first:last] - truth.values[first:last]).mean(axis=0) / std)
    return np.array(found)


@pytest.mark.parametrize("rho", [0.0, 0.6, 0.9])
def test_sigma_and_correlation_are_unbiased(bench_truth, rho: float) -> None:
    sigmas, rhos, means = [], [], []
    for seed in range(4):
        records = bench_truth.measured(seed, rho)
        noise = estimate_noise(records, NAMES)
        assert {channel.source for channel in noise.channels} == {"quiet"}
        assert [channel.law for channel in noise.channels] == [None] * len(NAMES)
        assert not noise.guessed
        sigmas.append(noise.sigma / SIGMA)
        rhos.append([channel.correlation for channel in noise.channels])
        means.append(stretch_means(bench_truth, records, noise))
        assert sum(channel.masked for channel in noise.channels) < 40
    assert np.mean(sigmas) == pytest.approx(1.0, abs=0.02)
    assert np.mean(rhos) == pytest.approx(rho, abs=0.02)
    assert np.std(means) == pytest.approx(1.0, abs=0.06)


@pytest.mark.parametrize("rho", [0.0, 0.6])
def test_total_sigma_and_means_are_right_for_a_ten_bit_converter(bench_truth, rho: float) -> None:
    total = np.sqrt(SIGMA**2 + STEP**2 / 12.0)
    sigmas, means = [], []
    for seed in range(3):
        records = bench_truth.measured(seed, rho, ten_bits=True)
        noise = estimate_noise(records, NAMES)
        assert [channel.step for channel in noise.channels] == pytest.approx(STEP, rel=1e-3)
        sigmas.append(noise.sigma / total)
        means.append(stretch_means(bench_truth, records, noise))
    assert np.mean(sigmas, axis=0) == pytest.approx(1.0, abs=0.035)
    assert np.mean(sigmas) == pytest.approx(1.0, abs=0.02)
    assert np.std(np.concatenate(means), axis=0) == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize("share", [0.3, 0.7])
def test_means_are_right_for_white_noise_plus_coloured_noise(
    plain_record: Callable[..., NoiseRecord], share: float
) -> None:
    rng = np.random.default_rng(11)
    z, sigmas = [], []
    for _ in range(10):
        errors = [
            np.sqrt(1 - share) * coloured(rng, 300, 0.8) + np.sqrt(share) * rng.standard_normal(300)
            for _ in range(20)
        ]
        records = [
            plain_record(each + np.linspace(0.0, rng.uniform(0, 30), 300), i) for i, each in enumerate(errors)
        ]
        channel = estimate_noise(records, ["x"]).channels[0]
        sigmas.append(channel.sigma)
        std = np.sqrt(channel.covariance(np.arange(60) * 0.01, 0.01).mean())
        z += [each[60 * k : 60 * k + 60].mean() / std for each in errors for k in range(5)]
    assert np.mean(sigmas) == pytest.approx(1.0, abs=0.03)
    assert np.std(z) == pytest.approx(1.0, abs=0.08)


def test_noise_is_estimated_from_replicates_where_every_record_moves_too_much(
    plain_record: Callable[..., NoiseRecord],
) -> None:
    rng = np.random.default_rng(5)
    times = np.arange(300) * 0.01
    records = []
    for condition in range(6):
        moving = 50.0 * np.sin(2 * np.pi * (6.0 + condition) * times)
        records += [plain_record(moving + 0.1 * coloured(rng, 300, 0.5), condition) for _ in range(3)]
    channel = estimate_noise(records, ["x"]).channels[0]
    assert channel.sigma == pytest.approx(0.1, rel=0.05)
    assert channel.correlation == pytest.approx(0.5, abs=0.06)
    assert channel.source == "replicates"
    assert "replicates" in channel.statement


def test_noise_of_a_signal_that_always_moves_is_reported_as_a_guess(
    plain_record: Callable[..., NoiseRecord],
) -> None:
    values = 50.0 * np.sin(2 * np.pi * 2.0 * np.arange(400) * 0.01)
    channel = estimate_noise([plain_record(values)], ["x"]).channels[0]
    assert channel.guessed
    assert "move as slowly as a signal" in channel.statement


@pytest.mark.parametrize("sigma", [0.0, 0.02, 0.1, 0.2])
@pytest.mark.parametrize("moving", [True, False])
def test_noise_hidden_by_a_converter_is_no_smaller_than_its_quantisation(
    plain_record: Callable[..., NoiseRecord], sigma: float, moving: bool
) -> None:
    rng = np.random.default_rng(12)
    slope = 30.0 * moving * np.linspace(0, 1, 300)
    records = [
        plain_record(np.round(rng.uniform(0, 9) + slope + sigma * rng.standard_normal(300)), i)
        for i in range(20)
    ]
    channel = estimate_noise(records, ["x"], known={"x": 0.1}).channels[0]
    total = np.sqrt(sigma**2 + 1.0 / 12.0)
    if moving:
        assert channel.step == pytest.approx(1.0)
        # for a slow signal the quantisation error is a sawtooth, which no noise model describes
        assert 0.9 * total < channel.sigma < 1.2 * total
    elif channel.step:
        assert 0.95 * np.sqrt(1.0 / 12.0) < channel.sigma < 1.5 * total
    else:  # the readings never change: nothing but the rig file says anything
        assert (channel.source, channel.sigma, channel.guessed) == ("rig", 0.1, True)


def test_noise_of_short_phases_is_estimated_from_differences() -> None:
    rng = np.random.default_rng(6)
    times = np.arange(240) * 0.01
    values = (3.0 * np.cos(5 * times) + 0.2 * rng.standard_normal(240))[:, None]
    record = NoiseRecord(times, values, 0, np.arange(240) // 10)
    channel = estimate_noise([record], ["x"]).channels[0]
    assert channel.source == "floor"
    assert channel.sigma == pytest.approx(0.2, rel=0.2)
    assert "white part alone" in channel.statement


def test_noise_that_the_data_do_not_show_is_taken_from_the_rig_file_and_reported() -> None:
    record = NoiseRecord(np.arange(100) * 0.01, np.full((100, 2), 300.0), 0, np.zeros(100, np.intp))
    noise = estimate_noise([record], ["told", "untold"], known={"told": 0.3})
    assert noise.guessed == ("told", "untold")
    assert noise.channel("told").sigma == 0.3
    assert noise.channel("told").source == "rig"
    assert noise.channel("untold").source == "assumed"
    assert noise.channel("untold").sigma > 0.0
    assert "only guessed for told, untold" in noise.statement


def test_a_rig_file_with_a_far_smaller_noise_is_reported(plain_record: Callable[..., NoiseRecord]) -> None:
    record = plain_record(np.random.default_rng(7).standard_normal(400))
    channel = estimate_noise([record], ["x"], known={"x": 0.1}).channels[0]
    assert channel.source == "quiet"
    assert "the rig file says" in channel.statement
    assert "times less" in channel.statement


def test_missing_samples_and_spikes_are_excluded(plain_record: Callable[..., NoiseRecord]) -> None:
    rng = np.random.default_rng(8)
    records = []
    for condition in range(10):
        values = 0.1 * coloured(rng, 400, 0.6) + np.linspace(0, 5, 400)
        values[rng.random(400) < 0.05] += 8.0
        values[rng.random(400) < 0.05] = np.nan
        records.append(plain_record(values, condition))
    channel = estimate_noise(records, ["x"]).channels[0]
    assert channel.sigma == pytest.approx(0.1, rel=0.08)
    assert channel.correlation == pytest.approx(0.6, abs=0.08)
    assert channel.masked > 150
    assert "spikes masked" in channel.statement


def test_estimates_do_not_depend_on_the_scale_of_the_values(plain_record: Callable[..., NoiseRecord]) -> None:
    values = coloured(np.random.default_rng(9), 800, 0.4)
    one = estimate_noise([plain_record(values)], ["x"]).channels[0]
    for scale in (1e-9, 1e9):
        other = estimate_noise([plain_record(scale * values)], ["x"]).channels[0]
        assert other.sigma / scale == pytest.approx(one.sigma, rel=1e-6)
        assert other.correlation == pytest.approx(one.correlation, abs=1e-6)


@pytest.mark.parametrize("size", [0, 1, 2, 5, 11, 12, 13, 40])
def test_records_of_any_length_give_an_estimate_without_a_warning(size: int) -> None:
    rng = np.random.default_rng(size)
    record = NoiseRecord(np.arange(size) * 0.01, rng.standard_normal((size, 1)), 0, np.zeros(size, np.intp))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        noise = estimate_noise([record], ["x"], known={"x": 1.0})
    assert noise.channels[0].sigma > 0.0


def test_the_noise_of_a_channel_without_readings_is_guessed() -> None:
    record = NoiseRecord(np.arange(50) * 0.01, np.full((50, 1), np.nan), 0, np.zeros(50, np.intp))
    assert estimate_noise([record], ["x"]).guessed == ("x",)


def test_a_number_of_channels_unequal_to_the_names_is_refused() -> None:
    record = NoiseRecord(np.arange(3) * 1.0, np.zeros((3, 2)), 0, np.zeros(3, np.intp))
    with pytest.raises(ValueError, match="channels"):
        estimate_noise([record], ["x"])
    with pytest.raises(ValueError, match="channels"):
        estimate_noise([], ["x"])


@pytest.mark.parametrize(
    ("times", "values", "phase"),
    [((0.0, 0.0), (2, 1), 2), ((0.0, 1.0), (3, 1), 2), ((0.0, 1.0), (2, 1), 3)],
)
def test_inconsistent_records_are_refused(times, values, phase) -> None:
    with pytest.raises(ValueError, match=r"times|phase"):
        NoiseRecord(np.array(times), np.zeros(values), 0, np.zeros(phase, np.intp))
