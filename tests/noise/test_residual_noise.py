"""The width of the noise from differences of residuals, unaffected by smooth or rare sharp misfits.

The generators are NumPy and SciPy alone.
"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from rigctl.noise import ModelResiduals, VarianceLaw, width_off_model

Floats = NDArray[np.float64]
SIZE, RECORDS = 400, 6


def levels(k: int) -> Floats:
    at = np.arange(SIZE)
    return np.asarray(20.0 * np.sin(at / 1.1 + k) + 15.0 * np.sin(at / 7.0 + 2.0 * k))


def left_over(errors: list[Floats], phase: NDArray[np.intp] | None = None) -> list[ModelResiduals]:
    still = np.zeros(SIZE, np.intp) if phase is None else phase
    return [ModelResiduals(one[:, None], levels(k)[:, None], still) for k, one in enumerate(errors)]


def noise(rng: np.random.Generator, correlation: float = 0.0) -> list[Floats]:
    drive = rng.standard_normal((RECORDS, SIZE)) * np.sqrt(1.0 - correlation**2)
    return [lfilter([1.0], [1.0, -correlation], one) for one in drive]


LAWS = {
    "a straight line": lambda y: 0.05 + 0.004 * (y + 35.0),
    "counts": lambda y: np.sqrt(0.05**2 + 2e-4 * np.maximum(y + 35.0, 0.0)),
    "a share of the size": lambda y: np.hypot(0.05, 0.008 * y),
    "narrower where it is high": lambda y: 0.05 + 0.004 * (35.0 - y),
}


@pytest.mark.parametrize("width", LAWS.values(), ids=LAWS)
def test_growth_with_the_level_is_estimated_despite_a_smooth_misfit(width) -> None:
    for seed in range(3):
        rng = np.random.default_rng(seed)
        misfit = 0.4 * np.sin(np.arange(SIZE) / 12.0)
        errors = [width(levels(k)) * one + misfit for k, one in enumerate(noise(rng))]
        found = width_off_model(left_over(errors), 0)
        assert found is not None
        assert found.law is not None
        at = np.linspace(-30.0, 30.0, 7)
        assert found.law.sigma(at, np.zeros(1)) == pytest.approx(width(at), rel=0.35)
        assert np.mean(np.abs(np.log(found.law.sigma(at, np.zeros(1)) / width(at)))) < 0.12


@pytest.mark.parametrize("correlation", [0.0, 0.6])
def test_constant_noise_has_its_sigma_and_no_law(correlation: float) -> None:
    for seed in range(4):
        errors = [0.1 * one for one in noise(np.random.default_rng(seed), correlation)]
        found = width_off_model(left_over(errors), 0, correlation=correlation)
        assert found is not None
        assert found.law is None
        assert found.sigma == pytest.approx(0.1, rel=0.06)
        assert 0.25 * SIZE * RECORDS < found.degrees < 0.7 * SIZE * RECORDS


def test_heavy_tails_have_fewer_degrees_of_freedom() -> None:
    rng = np.random.default_rng(1)
    errors = [rng.standard_t(5.0, SIZE) for _ in range(RECORDS)]
    found = width_off_model(left_over(errors), 0)
    assert found is not None
    assert found.sigma == pytest.approx(np.sqrt(5.0 / 3.0), rel=0.1)
    assert found.degrees < 0.9 * width_off_model(left_over(noise(rng)), 0).degrees


def test_a_misfit_at_a_few_edges_is_not_taken_for_growth() -> None:
    """After each switch the error rings for six samples, at the highest levels only."""
    rng = np.random.default_rng(2)
    ring = np.array([0.0, 2.0, -1.5, 1.0, -0.7, 0.4])
    errors = []
    for k, one in enumerate(noise(rng)):
        error = 0.1 * one
        for place in np.flatnonzero(levels(k) > 33.0)[::8].tolist():
            error[place : place + 6] += ring[: SIZE - place]
        errors.append(error)
    found = width_off_model(left_over(errors), 0)
    assert found is not None
    assert found.law is None


def test_no_noise_is_estimated_under_a_misfit_as_fast_as_the_sampling() -> None:
    at = np.arange(SIZE)
    errors = [
        0.05 * one + 0.4 * np.sin(at / 0.9 + k) for k, one in enumerate(noise(np.random.default_rng(3)))
    ]
    assert width_off_model(left_over(errors), 0) is None


def test_differences_are_not_taken_across_a_switch_or_a_gap() -> None:
    errors = [0.1 * one for one in noise(np.random.default_rng(4))]
    for one in errors:
        one[200:] += 50.0
        one[300] = np.nan
        one[301:] -= 20.0
    found = width_off_model(left_over(errors, np.repeat([0, 1], SIZE // 2)), 0)
    assert found is not None
    assert found.sigma == pytest.approx(0.1, rel=0.06)


def test_a_known_law_is_kept_if_the_new_one_is_no_likelier() -> None:
    rng = np.random.default_rng(5)
    width = LAWS["a straight line"]
    errors = [width(levels(k)) * one for k, one in enumerate(noise(rng))]
    known = [3.0 * width(levels(k)) for k in range(RECORDS)]  # of another scale, which is not part of the law
    found = width_off_model(left_over(errors), 0, known=known)
    assert found is not None
    assert found.law is None
    assert width_off_model(left_over(errors), 0, known=[np.ones(SIZE)] * RECORDS).law is not None


def test_few_readings_or_coarse_converter_steps_give_no_law() -> None:
    width = LAWS["a straight line"]
    errors = [width(levels(k)) * one for k, one in enumerate(noise(np.random.default_rng(6)))]
    assert (
        width_off_model(
            [ModelResiduals(errors[0][:60, None], levels(0)[:60, None], np.zeros(60, np.intp))], 0
        )
        is None
    )
    found = width_off_model(left_over(errors), 0, step=0.5)
    assert found is not None
    assert found.law is None


def test_scaling_a_law_scales_its_sigma() -> None:
    law = VarianceLaw(0.1, 0.02, 0.3, 5.0, 100, shot=0.04)
    level, slope = np.array([5.0, 7.0, -3.0]), np.array([0.0, 1.0, -2.0])
    assert law.scaled(3.0).sigma(level, slope) == pytest.approx(3.0 * law.sigma(level, slope))
