"""Noise that grows with the signal, has heavy tails or is coloured is learned without a model.

The generators are NumPy and SciPy alone.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter
from scipy.stats import chi2

from rigctl.noise import (
    ChannelNoise,
    NoiseModel,
    NoiseRecord,
    estimate_noise,
    find_spikes_in_records,
    spikes_of,
    whiten,
)
from rigctl.noise.statements import channel_statement
from rigctl.noise.variance import VarianceLaw, most_likely_squares

Floats = NDArray[np.float64]
SIZE, RECORDS, REST = 600, 12, 0.03


def coloured(rng: np.random.Generator, size: int, rho: float) -> Floats:
    drive = rng.standard_normal(size)
    drive[1:] *= np.sqrt(1.0 - rho**2)
    return np.asarray(lfilter([1.0], [1.0, -rho], drive))


def motor_force(rng: np.random.Generator) -> Floats:
    """One second at rest, three in motion under a slowly changing load, two at rest, at 100 Hz."""
    times = np.arange(SIZE) * 0.01
    keep = np.exp(-0.01 / 0.15)
    lagged = lfilter([1.0 - keep], [1.0, -keep], ((times > 1.0) & (times < 4.0)).astype(float))
    return np.asarray(rng.uniform(2.0, 20.0) * lagged * (1.0 + 0.1 * np.sin(2.0 * np.pi * 0.7 * times)))


def record(k: int, values: Floats, *, switched: bool = True) -> NoiseRecord:
    times = np.arange(values.size) * 0.01
    phase = (times > 1.0).astype(np.intp) + (times >= 4.0) if switched else np.zeros(values.size, np.intp)
    return NoiseRecord(times, values[:, None], k, phase)


def white(rng: np.random.Generator, truth: Floats) -> Floats:
    return REST * rng.standard_normal(truth.size)


def slow(rng: np.random.Generator, truth: Floats) -> Floats:
    return REST * coloured(rng, truth.size, 0.6)


def with_level(rng: np.random.Generator, truth: Floats) -> Floats:
    return np.hypot(REST, 0.03 * truth) * rng.standard_normal(truth.size)


def slow_with_level(rng: np.random.Generator, truth: Floats) -> Floats:
    return np.hypot(REST, 0.03 * truth) * coloured(rng, truth.size, 0.5)


def with_rate(rng: np.random.Generator, truth: Floats) -> Floats:
    return np.hypot(REST, 0.02 * np.gradient(truth, 0.01)) * rng.standard_normal(truth.size)


def with_tails(rng: np.random.Generator, truth: Floats) -> Floats:
    return REST / np.sqrt(3.0) * rng.standard_t(3.0, truth.size)


NOISES = {one.__name__: one for one in (white, slow, with_level, slow_with_level, with_tails)}


def campaign(
    seed: int, noise: Callable[[np.random.Generator, Floats], Floats]
) -> tuple[list[NoiseRecord], list[Floats]]:
    rng = np.random.default_rng(seed)
    truth = [motor_force(rng) for _ in range(RECORDS)]
    return [record(k, one + noise(rng, one)) for k, one in enumerate(truth)], truth


def learned(records: list[NoiseRecord]) -> tuple[NoiseModel, list[NDArray[np.bool_]]]:
    spikes = spikes_of(records)
    return estimate_noise(records, ["force"], spikes=spikes), [~mask for mask in spikes]


def residuals(noise: NoiseModel, records: list[NoiseRecord], ok: list, truth: list[Floats]) -> list[Floats]:
    """Whitened residuals of the true course, record by record."""
    return [
        whiten(noise, one.times, good, sigma=noise.sigma_at(np.where(good, one.values, np.nan), one.times))(
            np.where(good, one.values - course[:, None], 0.0)
        )
        for one, good, course in zip(records, ok, truth, strict=True)
    ]


@pytest.mark.parametrize("noise", NOISES.values(), ids=NOISES)
def test_a_true_model_has_unit_residuals_and_raises_no_excess_of_alarms(
    noise: Callable[[np.random.Generator, Floats], Floats],
) -> None:
    """Mean squares of stretches are 1, and of up to 480 tests of means at 1 % no more than 3 % reject."""
    squares, alarms, tests = [], 0, 0
    for seed in range(2 if noise is with_tails else 8):
        records, truth = campaign(seed, noise)
        model, ok = learned(records)
        for white in residuals(model, records, ok, truth):
            for part in np.array_split(white, 5):
                squares.append(float(np.mean(part**2)))
                mean = float(part.sum() ** 2 / part.size)
                alarms += int(chi2.sf(mean, 1) < 0.01)
                tests += 1
    assert np.mean(squares) == pytest.approx(1.0, abs=0.08)
    assert alarms <= 0.03 * tests


@pytest.mark.parametrize(("share", "rest"), [(0.005, 0.03), (0.03, 1e-3), (0.2, 0.05)])
def test_noise_in_proportion_to_the_level_is_estimated_accurately(share: float, rest: float) -> None:
    for seed in range(4):
        records, _ = campaign(
            seed, lambda rng, truth: np.hypot(rest, share * truth) * rng.standard_normal(truth.size)
        )
        law = learned(records)[0].channels[0].law
        assert law is not None
        assert law.level == pytest.approx(share, rel=0.1 if share > 0.01 else 0.2)
        assert law.rate == pytest.approx(0.0, abs=1e-4)
        assert law.floor == pytest.approx(rest, rel=0.15)


def test_noise_at_rest_is_not_used_in_motion() -> None:
    """With the noise at rest the true force would be far outside its noise in motion."""
    records, truth = campaign(3, with_level)
    model, ok = learned(records)
    channel = model.channels[0]
    moving = np.concatenate([one[150:380] for one in truth])
    at_rest = np.concatenate(
        [
            np.where(good, one.values, np.nan)[150:380, 0] - course[150:380]
            for one, good, course in zip(records, ok, truth, strict=True)
        ]
    )
    assert np.nanmean((at_rest / REST) ** 2) > 50.0
    assert channel.law is not None
    assert "grows with the level (by 3" in channel.statement
    assert channel.sigma == pytest.approx(
        np.sqrt(np.mean(np.concatenate([REST**2 + (0.03 * one) ** 2 for one in truth]))), rel=0.1
    )
    assert np.median(np.abs(moving)) > 1.0


@pytest.mark.parametrize("noise", [white, slow, with_tails])
def test_constant_noise_has_no_law(noise: Callable[..., Floats]) -> None:
    for seed in range(3):
        assert learned(campaign(seed, noise)[0])[0].channels[0].law is None


def test_ringing_at_fast_changes_is_not_noise() -> None:
    """A lightly damped oscillation of 43 Hz after each switch, sampled at 100 Hz."""
    rng = np.random.default_rng(4)
    records = []
    for k in range(RECORDS):
        since = np.arange(SIZE) * 0.01
        course = motor_force(rng)
        for switch in (1.0, 4.0):
            after = np.maximum(since - switch, 0.0)
            course = course + 3.0 * np.exp(-after / 0.08) * np.sin(2.0 * np.pi * 43.0 * after)
        records.append(record(k, course + white(rng, course)))
    assert learned(records)[0].channels[0].law is None


def test_noise_that_follows_the_rate_is_distinguished_from_noise_of_the_level() -> None:
    """Jitter of the clock shows where a sine is steep, not where it is high."""
    rng = np.random.default_rng(5)
    times = np.arange(SIZE) * 0.01
    records = []
    for k in range(RECORDS):
        course = rng.uniform(2.0, 6.0) * np.sin(2.0 * np.pi * 0.5 * times + rng.uniform(0.0, 6.0))
        records.append(record(k, course + with_rate(rng, course), switched=False))
    law = learned(records)[0].channels[0].law
    assert law is not None
    assert law.level < 0.005
    assert law.rate == pytest.approx(0.02, rel=0.15)


def test_the_level_of_a_temperature_counts_from_its_lowest_value() -> None:
    rng = np.random.default_rng(6)
    records = []
    for k in range(RECORDS):
        above = 60.0 * (1.0 - np.exp(-np.arange(SIZE) / 150.0))
        noise = np.hypot(0.05, 0.01 * above) * rng.standard_normal(SIZE)
        records.append(record(k, 293.0 + above + noise, switched=False))
    law = learned(records)[0].channels[0].law
    assert law is not None
    assert law.origin == pytest.approx(293.0, abs=5.0)
    assert law.level == pytest.approx(0.01, rel=0.15)


@pytest.mark.parametrize("every", [15, 40, 200])
def test_frequent_spikes_are_masked_and_counted(every: int) -> None:
    """A heater switched after every `every` samples; spikes of 3 K or more in noise of 0.1 K."""
    rng = np.random.default_rng(7)
    records, hits = [], []
    for k in range(RECORDS):
        on = (np.arange(1000) // every) % 2
        keep = np.exp(-5.0 / 100.0)
        course = 300.0 + 20.0 * lfilter([1.0 - keep], [1.0, -keep], on)
        hit = rng.random(1000) < 1280 / 12000
        spikes = hit * rng.choice([-1.0, 1.0], 1000) * (3.0 + rng.exponential(3.0, 1000))
        values = course + 0.1 * rng.standard_normal(1000) + spikes
        phase = (np.arange(1000) // every).astype(np.intp)
        records.append(NoiseRecord(np.arange(1000) * 5.0, values[:, None], k, phase))
        hits.append(hit)
    found = np.concatenate([mask[:, 0] for mask in find_spikes_in_records(records)])
    truth = np.concatenate(hits)
    assert (found & truth).sum() > (0.9 if every > 15 else 0.7) * truth.sum()
    assert (found & ~truth).sum() < 0.002 * truth.size


def test_a_slow_signal_with_coarse_quantisation_keeps_its_sigma() -> None:
    rng = np.random.default_rng(8)
    step = 0.005
    records = []
    for k in range(RECORDS):
        level = rng.uniform(0.1, 0.5) + 0.3 * (1.0 - np.exp(-np.arange(400) / 120.0))
        values = np.round((level + 0.004 * rng.standard_normal(400)) / step) * step
        records.append(NoiseRecord(np.arange(400) * 4.0, values[:, None], k, np.zeros(400, np.intp)))
    channel = estimate_noise(records, ["level"]).channels[0]
    assert channel.sigma == pytest.approx(np.hypot(0.004, step / np.sqrt(12.0)), rel=0.1)
    assert channel.law is None


def test_a_channel_without_a_law_has_one_sigma() -> None:
    channel = ChannelNoise("x", 0.5)
    assert channel.sigma_at(np.array([1.0, np.nan, -3.0]), np.arange(3.0)).tolist() == [0.5, 0.5, 0.5]


@pytest.mark.parametrize(
    ("origin", "of"),
    [
        (0.0, "3 % of it)"),
        (293.0, "3 % of its distance from the lowest"),
        (-5.0, "the highest level"),
    ],
)
def test_the_statement_names_the_reference_of_a_level(origin: float, of: str) -> None:
    law = VarianceLaw(0.01, 0.03, 0.0, origin, 50)
    assert of in channel_statement(ChannelNoise("body", 0.05, source="quiet", guessed=False, law=law), None)


@pytest.mark.parametrize(
    ("level", "said"),
    [(0.0, "(by the root of its distance from the lowest level)"), (0.03, "level and the root of that)")],
)
def test_the_statement_says_that_counting_noise_grows_with_the_root_of_the_level(
    level: float, said: str
) -> None:
    law = VarianceLaw(0.01, level, 0.0, 293.0, 50, shot=1e-3)
    assert said in channel_statement(
        ChannelNoise("body", 0.05, source="residuals", guessed=False, law=law), None
    )


def _by_multiplications(terms: Floats, variance: Floats) -> Floats:
    """The iteration of `most_likely_squares`, written as its formula."""
    mean = np.maximum(terms.mean(axis=0), 1e-300)
    squares = variance.mean() / (terms.shape[1] * mean)
    for _ in range(100):
        weight = 1.0 / np.maximum(terms @ squares, 1e-300)
        squares = squares * np.sqrt(terms.T @ (variance * weight**2) / np.maximum(terms.T @ weight, 1e-300))
    return np.asarray(squares)


@pytest.mark.parametrize("count", [1, 7, 8, 255, 256, 1001])
@pytest.mark.parametrize("columns", [1, 2, 3])
def test_the_most_likely_squares_agree_with_their_formula(count: int, columns: int) -> None:
    rng = np.random.default_rng(count + columns)
    terms = np.column_stack([np.ones(count), rng.random(count), rng.random(count) ** 2])[:, :columns]
    variance = 1e-12 * (1.0 + terms.sum(axis=1)) * rng.chisquare(1, count)
    found = most_likely_squares(terms, variance)
    np.testing.assert_allclose(found, _by_multiplications(terms, variance), rtol=1e-10, atol=1e-300)


def test_readings_without_variance_have_zero_squares() -> None:
    terms = np.column_stack([np.ones(30), np.linspace(0.0, 1.0, 30)])
    assert most_likely_squares(terms, np.zeros(30)).tolist() == [0.0, 0.0]


def test_a_term_that_is_zero_everywhere_is_harmless() -> None:
    variance = np.random.default_rng(1).chisquare(1, 40)
    found = most_likely_squares(np.column_stack([np.ones(40), np.zeros(40)]), variance)
    assert found[0] == pytest.approx(variance.mean())
    assert np.isfinite(found[1])
