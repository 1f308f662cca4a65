"""The noise of measurements: omitted readings are counted in the chosen records, and noise is never zero."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from rigctl.model.measured.noise import DataNoise, noise_of, with_noise_off_model, with_spikes_off_model
from rigctl.model.measured.record import MeasuredRecord, Measurements
from rigctl.noise import ChannelNoise, NoiseModel


def record(
    index: int, values: np.ndarray, *, row: bool = False, switched: float | None = None
) -> MeasuredRecord:
    """Samples at 1 Hz; the input goes to 1 at the time `switched`."""
    times = np.zeros(1) if switched is None else np.array([0.0, switched])
    return MeasuredRecord(
        run="r",
        index=index,
        label=f"r/{index + 1}",
        times=np.arange(float(values.size)),
        switch_times=times,
        switch_half=np.zeros(times.size),
        inputs=np.arange(float(times.size))[:, None],
        values=values[:, None],
        condition={"oil": 300.0 + index},
        group=index,
        phase=np.zeros(values.size, dtype=np.int64),
        phases=("hold",),
        row=row,
    )


def measured(records: Sequence[MeasuredRecord]) -> Measurements:
    return Measurements(("position",), ("mm",), ("valve",), tuple(records), None, ("r",))


def test_spikes_and_edges_are_counted_in_the_selected_records_only() -> None:
    rng = np.random.default_rng(1)
    values = [1e-4 * rng.standard_normal(400) for _ in range(3)]
    for place in (50, 150, 250):
        values[0][place] += 0.02
    values[1][200] += 0.02
    values[2][200:] += 0.05  # an edge within one sample
    switched = (None, None, 200.0)
    noise = noise_of(
        measured(
            [record(k, one, switched=at) for k, (one, at) in enumerate(zip(values, switched, strict=True))]
        )
    )
    channel = noise.model.channels[0]
    assert (channel.masked, channel.statement.endswith("; 4 spikes masked")) == (4, True)
    assert channel.edges > 0
    one = noise.only([1])
    assert (one.model.channels[0].masked, one.model.channels[0].edges) == (1, 0)
    assert one.model.statement == noise.model.statement.replace("4 spikes", "1 spike")
    assert one.model.sigma == pytest.approx(noise.model.sigma, rel=0.0)
    none = noise.only([1, 2]).only([1])
    assert (none.model.channels[0].masked, none.model.channels[0].edges) == (0, channel.edges)
    assert "masked" not in none.model.statement + none.model.channels[0].statement


@pytest.mark.parametrize(
    ("values", "sigma"), [([0.0, 0.0, 4.0], 0.02), ([0.0, 0.0, 0.0], 0.005), ([2.0, 2.0, 4.0], 0.01)]
)
def test_the_noise_of_a_few_values_is_guessed_and_never_zero(values: list[float], sigma: float) -> None:
    """0.5 % of the typical value; of the largest value if that is 0; of 1 if all are 0."""
    rows = [record(k, np.array([value]), row=True) for k, value in enumerate(values)]
    (channel,) = noise_of(measured(rows)).model.channels
    assert channel.guessed
    assert channel.sigma == pytest.approx(sigma)


def test_spikes_during_motion_are_found_in_the_residuals_of_a_model() -> None:
    rng = np.random.default_rng(2)
    moving = np.sin(np.arange(600) / 12.0)
    clean = [moving + 1e-2 * rng.standard_normal(600) for _ in range(3)]
    spiky = [values.copy() for values in clean]
    for values in spiky:
        places = rng.permutation(np.arange(30, 270, 12))[:15]
        values[places[:8]] += 0.5
        values[places[8:]] += 0.07
    lacks = 0.05 * np.exp(-(((np.arange(600) - 450) / 4.0) ** 2))  # a short misfit of the model is no spike
    for given in (spiky, clean):
        measurements = measured([record(k, values) for k, values in enumerate(given)])
        noise = noise_of(measurements)
        errors = [((moving + lacks - values) / 1e-2)[:, None] for values in given]
        found = with_spikes_off_model(noise, measurements, errors)
        if given is clean:
            assert found is None
            continue
        assert found is not None
        assert found.model.channels[0].masked > noise.model.channels[0].masked
        assert sum(int((~good[30:270]).sum()) for good in found.ok) == pytest.approx(45, abs=4)
        assert all(good[440:461].all() for good in found.ok)
        assert f"{found.model.channels[0].masked} spikes masked" in found.model.statement


def test_noise_without_rest_is_estimated_from_residuals() -> None:
    rng = np.random.default_rng(3)
    sigma, at = 1e-2, np.arange(400)
    moving = [np.sin(at / 6.0 + 2.0 * k) + 0.5 * np.sin(at / 3.3 + k) for k in range(4)]
    lacks = 3.0 * sigma * np.sin(at / 60.0)  # a missing effect is smooth within a window
    given = [one + sigma * rng.standard_normal(at.size) for one in moving]
    measurements = measured([record(k, values) for k, values in enumerate(given)])
    noise = noise_of(measurements)
    before = noise.model.channels[0]
    assert before.guessed or before.correlation > 0.9
    assert before.sigma > 2.0 * sigma
    outputs = [(one + lacks)[:, None] for one in moving]
    found = with_noise_off_model(noise, measurements, outputs)
    assert found is not None
    channel = found.model.channels[0]
    assert channel.sigma == pytest.approx(sigma, rel=0.08)
    assert (channel.source, channel.guessed) == ("residuals", False)
    assert "from the model's residuals" in found.model.statement
    # residuals larger than the noise are no estimate of it
    wrong = [one + 2.0 * before.sigma for one in outputs]
    assert with_noise_off_model(noise, measurements, wrong) is None


def test_noise_growth_hidden_by_motion_is_estimated_from_residuals() -> None:
    """Five samples to a period: σ goes from a half to twice 1 %, in a straight line from the lowest level."""
    rng = np.random.default_rng(4)
    at = np.arange(300)
    moving = [np.sin(at / 0.8 + 2.0 * k) + np.sin(at / 3.3 + k) for k in range(6)]
    widths = [1e-2 * (0.5 + 1.5 * (one + 2.0) / 4.0) for one in moving]
    given = [one + wide * rng.standard_normal(at.size) for one, wide in zip(moving, widths, strict=True)]
    measurements = measured([record(k, values) for k, values in enumerate(given)])
    noise = replace(noise_of(measurements), model=flat(1e-2), grown=None)
    lacks = 0.02 * np.sin(at / 25.0)  # a missing effect is smooth
    found = with_noise_off_model(noise, measurements, [(one + lacks)[:, None] for one in moving])
    assert found is not None
    assert found.grown is not None
    for sigma, wide in zip(found.grown, widths, strict=True):
        off = np.abs(np.log(sigma[:, 0] / wide))
        assert (off.mean() < 0.2, off.max() < 0.5) == (True, True)
    assert found.only([1, 2]).grown == found.grown[1:3]
    assert "grows with the level" in found.model.statement


def test_the_sigma_of_heavy_tailed_noise_is_that_of_the_unmasked_residuals() -> None:
    rng = np.random.default_rng(5)
    tails = [1e-2 / np.sqrt(3.0) * rng.standard_t(3.0, 600) for _ in range(6)]
    measurements = measured([record(k, values) for k, values in enumerate(tails)])
    noise = noise_of(measurements)
    assert noise.model.channels[0].masked > 3
    narrow = replace(noise, model=flat(7e-3, masked=noise.model.channels[0].masked))
    found = with_noise_off_model(narrow, measurements, [np.zeros((600, 1))] * 6)
    assert found is not None
    left = np.concatenate([values[good[:, 0]] for values, good in zip(tails, noise.ok, strict=True)])
    assert found.model.sigma == pytest.approx(np.sqrt(np.mean(left**2)), rel=0.05)
    assert found.model.channels[0].degrees < 0.45 * left.size  # fewer than those of normal noise


def test_spikes_near_ends_and_switches_are_found_in_residuals() -> None:
    rng = np.random.default_rng(6)
    errors = [rng.standard_normal((200, 1)) for _ in range(4)]
    spikes = [(0, 198), (0, 60), (1, 105), (1, 20), (2, 160), (3, 20)]
    for place, sample in spikes:
        errors[place][sample] += 12.0
    records = [record(k, np.zeros(200)) for k in range(4)]
    records = [replace(one, phase=np.repeat([0, 1], 100)) for one in records]
    noise = DataNoise(flat(1.0, masked=8), tuple(one.here for one in records))
    found = with_spikes_off_model(noise, measured(records), errors)
    assert found is not None
    assert [(k, int(i)) for k, good in enumerate(found.ok) for i in np.flatnonzero(~good[:, 0])] == sorted(
        spikes
    )


def flat(sigma: float, masked: int = 0) -> NoiseModel:
    """White noise of one width, well known."""
    channel = ChannelNoise("position", sigma, source="quiet", guessed=False, degrees=1000, masked=masked)
    return NoiseModel((channel,), 1.0)
