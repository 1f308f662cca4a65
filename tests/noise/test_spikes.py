"""Spikes are found; strokes, steps, ramps, peaks at a switch and toggling converters are not spikes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigctl.noise import NoiseRecord, find_spikes, find_spikes_in_records
from rigctl.noise.spikes import _medians, _quantile, find_spikes_on_scales


@pytest.mark.parametrize(("rho", "ten_bits"), [(0.0, False), (0.6, False), (0.6, True), (0.0, True)])
def test_a_noisy_stroke_has_no_spikes(bench_truth, rho: float, ten_bits: bool) -> None:
    records = bench_truth.measured(1, rho, ten_bits=ten_bits)
    masks = [find_spikes(record.times, record.values, record.phase) for record in records]
    assert np.mean(masks) < 2e-4  # normal noise exceeds 4.5 sigma in one sample of 150 000


def test_a_noise_free_stroke_has_no_spikes_with_or_without_a_converter(bench_truth) -> None:
    step = np.array([0.25, 1.2e4, 3e-4, 1.2e4, 1.2e4])
    for record in bench_truth.records:
        assert not find_spikes(record.times, record.values, record.phase).any()
        coarse = np.round(record.values / step) * step
        assert not find_spikes(record.times, coarse, record.phase).any()


def test_spikes_on_a_stroke_are_found(bench_truth) -> None:
    rng = np.random.default_rng(3)
    found = wrong = put = 0
    for record in bench_truth.measured(3, 0.3):
        guard = np.zeros(record.times.size, bool)
        for switch in np.flatnonzero(np.diff(record.phase)) + 1:
            guard[switch - 1 : switch + 10] = True
        where = (rng.random(record.times.size) < 0.03) & ~guard
        values = record.values[:, 2:3].copy()
        values[where, 0] += rng.choice([-1.0, 1.0], where.sum()) * rng.uniform(5e-3, 5e-2, where.sum())
        mask = find_spikes(record.times, values, record.phase)[:, 0]
        found, wrong, put = found + (mask & where).sum(), wrong + (mask & ~where).sum(), put + where.sum()
    assert found > 0.97 * put
    assert wrong < 0.03 * put


@pytest.mark.parametrize("share", [0.02, 0.08, 0.16])
@pytest.mark.parametrize("step", [0.0, 0.49])
def test_spikes_of_a_slow_heater_are_found(share: float, step: float) -> None:
    rng = np.random.default_rng(4)
    times = np.arange(1200.0)
    truth = 300.0 + 50.0 * (1.0 - np.exp(-times / 180.0))
    values = truth + 0.3 * rng.standard_normal(1200)
    where = rng.random(1200) < share
    values[where] += rng.choice([-1.0, 1.0, 1.0], where.sum()) * rng.uniform(3.0, 30.0, where.sum())
    values[0] = 295.0  # a placeholder that the logger writes
    if step:
        values = np.round(values / step) * step
    mask = find_spikes(times, values[:, None])[:, 0]
    assert mask[0]
    assert (mask & where).sum() > 0.93 * where.sum()
    assert (mask & ~where)[1:].sum() <= 3


def test_bursts_of_up_to_three_samples_are_spikes_and_longer_ones_are_signal() -> None:
    values = 0.1 * np.random.default_rng(5).standard_normal(400)
    for place, length in ((50, 1), (100, 2), (150, 3), (250, 6)):
        values[place : place + length] += 5.0
    mask = find_spikes(np.arange(400) * 0.01, values[:, None])[:, 0]
    assert np.flatnonzero(mask).tolist() == [50, 100, 101, 150, 151, 152]


@settings(max_examples=40)
@given(seed=st.integers(0, 2**32 - 1), height=st.floats(0.5, 100.0), ramp=st.floats(-20.0, 20.0))
def test_steps_and_ramps_are_not_spikes(seed: int, height: float, ramp: float) -> None:
    rng = np.random.default_rng(seed)
    values = 0.1 * rng.standard_normal(300)
    values[100:] += height
    values[200:] += ramp * np.arange(100) * 0.1
    # white noise has a few outlying values in a thousand
    assert find_spikes(np.arange(300) * 0.01, values[:, None])[:, 0].sum() <= 6


def test_ringing_is_not_a_spike() -> None:
    times = np.arange(400) * 0.01
    after = np.maximum(0.0, times - 2.0)
    values = 5.0 * (times > 2.0) * (1.0 - np.exp(-8 * after) * np.cos(60 * after))
    values += 0.02 * np.random.default_rng(6).standard_normal(400)
    assert not find_spikes(times, values[:, None]).any()


def test_a_peak_right_after_a_switch_is_not_a_spike() -> None:
    times = np.arange(200) * 0.01
    values = 0.01 * np.random.default_rng(7).standard_normal((200, 1))
    values[102] += 3.0
    phase = (np.arange(200) >= 100).astype(np.intp)
    assert find_spikes(times, values)[102, 0]
    assert not find_spikes(times, values, phase).any()


def test_a_peak_common_to_all_records_is_not_a_spike() -> None:
    rng = np.random.default_rng(8)
    records = []
    for _ in range(6):
        values = 0.01 * rng.standard_normal((200, 1))
        values[150] += 3.0
        records.append(NoiseRecord(np.arange(200) * 0.01, values, 0, np.zeros(200, np.intp)))
    records[0].values[60] += 3.0
    masks = find_spikes_in_records(records)
    assert np.flatnonzero(masks[0]).tolist() == [60]
    assert not np.any(masks[1:])


def test_spikes_on_two_scales_at_once_equal_those_of_each_scale() -> None:
    rng = np.random.default_rng(10)
    records = []
    for _ in range(5):
        wide = np.where(np.arange(300) % 100 < 50, 0.01, 0.1)[:, None]
        values = wide * rng.standard_t(3, (300, 2))
        records.append(NoiseRecord(np.arange(300) * 0.01, values, 0, np.arange(300) // 100))
    both = find_spikes_on_scales(records, (False, True))
    for masks, local in zip(both, (False, True), strict=True):
        alone = find_spikes_in_records(records, local=local)
        assert all(np.array_equal(one, other) for one, other in zip(masks, alone, strict=True))
    assert sum(mask.sum() for mask in both[0]) > sum(mask.sum() for mask in both[1]) > 0


def test_missing_values_are_not_spikes_and_hide_none() -> None:
    values = 0.1 * np.random.default_rng(9).standard_normal((300, 2))
    values[40:60, 0] = np.nan
    values[:, 1] = np.nan
    values[80, 0] = 4.0
    assert np.argwhere(find_spikes(np.arange(300) * 0.01, values)).tolist() == [[80, 0]]


@pytest.mark.parametrize("size", [0, 1, 5, 9, 10, 12])
def test_short_records_have_no_spikes(size: int) -> None:
    assert not find_spikes(np.arange(size) * 1.0, np.zeros((size, 2))).any()


@pytest.mark.parametrize("size", [1, 2, 5, 8, 9, 376])
def test_medians_and_quantiles_equal_those_of_numpy(size: int) -> None:
    rows = np.random.default_rng(size).standard_normal((7, size))
    np.testing.assert_array_equal(_medians(rows), np.median(rows, axis=1))
    for share in (0.0, 0.25, 0.5, 0.68, 1.0):
        assert _quantile(rows[0], share) == np.quantile(rows[0], share)
