"""Noise of tables, estimated from neighbouring rows without a model."""

from __future__ import annotations

import csv

import numpy as np
import pytest

from rigctl.files.shipped import shipped
from rigctl.noise import ChannelNoise, NoiseModel, row_noise, same_reading, whiten

TEMPERATURES = np.arange(20.0, 81.0, 5.0)
ONE = np.zeros(TEMPERATURES.size, dtype=np.intp)


def vogel(temperature: np.ndarray) -> np.ndarray:
    return 3.1083e-5 * np.exp(1132.5833 / (temperature + 273.15 - 147.4466))


def published(column: str) -> np.ndarray:
    with shipped("data", "hl32-viscosity.csv").open(encoding="utf-8") as file:
        return np.array([float(row[column]) for row in csv.DictReader(file)])


def test_the_published_viscosities_have_a_noise_of_0_7_percent() -> None:
    found = row_noise(TEMPERATURES, published("kinematic_viscosity [cSt]"), ONE)
    assert found is not None
    assert found.relative
    assert found.sigma == pytest.approx(0.0072, abs=1e-4)
    assert (found.differences, found.repeats, found.degrees) == (10, 0, 4)


def test_relative_noise_is_recovered_with_its_degrees_of_freedom() -> None:
    rng = np.random.default_rng(1)
    squares = []
    for _ in range(2000):
        found = row_noise(TEMPERATURES, vogel(TEMPERATURES) * np.exp(0.007 * rng.standard_normal(13)), ONE)
        assert found is not None
        squares.append(found.sigma**2)
    assert np.sqrt(np.mean(squares)) == pytest.approx(0.007, rel=0.03)
    assert 2.0 * np.mean(squares) ** 2 / np.var(squares) == pytest.approx(4.7, rel=0.15)


def test_values_of_similar_size_have_absolute_noise_even_at_irregular_points() -> None:
    rng = np.random.default_rng(2)
    x = np.sort(rng.uniform(0.0, 10.0, 200))
    found = row_noise(x, 100.0 + 3.0 * np.sin(x) + 0.2 * rng.standard_normal(200), np.zeros(200, np.intp))
    assert found is not None
    assert not found.relative
    assert found.sigma == pytest.approx(0.2, rel=0.15)


def test_curvature_beyond_a_quadratic_is_not_taken_for_noise() -> None:
    """A viscosity from −20 to 100 °C without noise, for which four-point differences would give 0.35 %."""
    wide = np.arange(-20.0, 101.0, 10.0)
    bare = row_noise(wide, vogel(wide), ONE)
    assert bare is not None
    assert bare.sigma < 6e-4
    rng = np.random.default_rng(6)
    squares = []
    for _ in range(300):
        found = row_noise(wide, vogel(wide) * np.exp(0.001 * rng.standard_normal(13)), ONE)
        assert found is not None
        squares.append(found.sigma**2)
    assert np.sqrt(np.mean(squares)) == pytest.approx(0.00112, rel=0.1)
    assert found.differences == 9


def test_pure_noise_is_estimated_from_four_neighbouring_points() -> None:
    rng = np.random.default_rng(7)
    for _ in range(500):
        found = row_noise(TEMPERATURES, 100.0 + rng.standard_normal(13), ONE)
        assert found is not None
        assert found.differences == 10


def test_each_curve_is_evaluated_by_itself() -> None:
    points, series = np.tile(np.arange(10.0), 2), np.repeat([0, 1], 10)
    rng = np.random.default_rng(3)
    values = 90.0 * series + 0.1 * rng.standard_normal(20)
    found = row_noise(points, 100.0 + values, series.astype(np.intp))
    assert found is not None
    assert found.differences == 14
    assert found.sigma == pytest.approx(0.1, rel=0.5)


def test_repeats_count_and_their_mean_represents_the_point() -> None:
    rng = np.random.default_rng(4)
    points = np.repeat(np.arange(6.0), 5)
    found = row_noise(points, 50.0 + 0.3 * rng.standard_normal(30), np.zeros(30, np.intp))
    assert found is not None
    assert (found.repeats, found.differences) == (24, 27)
    assert found.sigma == pytest.approx(0.3, rel=0.25)


@pytest.mark.parametrize("count", [3, 8])
def test_too_few_rows_give_no_noise(count: int) -> None:
    assert row_noise(np.arange(float(count)), np.ones(count), np.zeros(count, np.intp)) is None


def test_rows_without_scatter_give_no_noise() -> None:
    assert row_noise(np.arange(12.0), np.full(12, 5.0), np.zeros(12, np.intp)) is None


def test_a_derived_column_is_detected() -> None:
    kinematic = published("kinematic_viscosity [cSt]")
    dynamic = published("dynamic_viscosity [Pa*s]")
    law = published("kinematic_viscosity_vogel [cSt]")
    assert same_reading(kinematic, dynamic, TEMPERATURES, ONE)
    assert not same_reading(kinematic, law, TEMPERATURES, ONE)


def test_whitening_divides_each_value_by_its_relative_sigma() -> None:
    noise = NoiseModel((ChannelNoise("nu", 1e-6, share=0.01),), 1.0)
    values = np.array([[85e-6], [9e-6], [0.0]])
    ok = np.array([[True], [True], [False]])
    whitener = whiten(noise, np.arange(3.0), ok, sigma=noise.sigma_at(values))
    assert whitener(np.array([[0.85e-6], [0.18e-6], [1.0]])) == pytest.approx([1.0, 2.0])
    assert whitener.log_determinant == pytest.approx(2.0 * np.log(0.85e-6 * 0.09e-6))
    assert noise.sigma_at(values)[:, 0] == pytest.approx([0.85e-6, 0.09e-6, 1e-6])
