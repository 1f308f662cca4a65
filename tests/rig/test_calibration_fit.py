"""A calibration from points: the polynomial and its uncertainty."""

from __future__ import annotations

import math
from itertools import accumulate

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigctl.errors import RigctlError
from rigctl.rig import Channel, Raw
from rigctl.rig.calibration import polynomial
from rigctl.rig.calibration_fit import CalibrationFit, Point, fit_calibration

PRESSURE = Channel(unit="bar", quantity="pressure", raw=Raw(bits=16, low=0.0, high=65535.0))
LINE = (-12.5, 0.0019)


def points_on(
    coefficients: tuple[float, ...], raws: list[float], noise: float = 0.0, seed: int = 1
) -> list[Point]:
    """Points whose reference values scatter by `noise` bar around the curve."""
    chance = np.random.default_rng(seed)
    return [Point(polynomial(coefficients, raw) + noise * chance.standard_normal(), (raw,)) for raw in raws]


def fitted(points: list[Point], degree: int = 1, **more: float) -> CalibrationFit:
    return fit_calibration(PRESSURE, points, degree, **more)


def test_exact_points_give_the_line_and_the_uncertainty_of_the_converter() -> None:
    fit = fitted(points_on(LINE, [7000.0, 20000.0, 40000.0, 60000.0]))
    assert fit.coefficients == pytest.approx(LINE, rel=1e-9)
    assert fit.residual_std == pytest.approx(0.0, abs=1e-9)
    step = PRESSURE.raw.step * LINE[1]
    assert fit.uncertainty == pytest.approx(
        2.0 * step / math.sqrt(12.0), rel=1e-6
    )  # that of the converter alone


@settings(max_examples=30)
@given(
    st.floats(-100.0, 100.0),
    st.floats(2e-4, 1e-2),
    st.floats(-1e-9, 1e-9),
    st.lists(st.integers(1000, 7000), min_size=5, max_size=9),
)
def test_a_quadratic_fit_reproduces_points_on_a_parabola(
    offset: float, slope: float, bend: float, gaps: list[int]
) -> None:
    raws = list(accumulate(gaps))  # at most 63 000 of 65 535
    wanted = (offset, slope, bend)
    fit = fitted(points_on(wanted, [float(raw) for raw in raws]), 2)
    for raw in raws:
        assert polynomial(fit.coefficients, float(raw)) == pytest.approx(
            polynomial(wanted, float(raw)), abs=1e-6
        )


def test_the_fit_agrees_with_numpy() -> None:
    points = points_on(LINE, [5000.0, 15000.0, 30000.0, 45000.0, 62000.0], noise=0.05)
    fit = fitted(points)
    x, y = np.array([p.mean for p in points]), np.array([p.reference for p in points])
    slope_first, covariance = np.polyfit(x, y, 1, cov=True)
    assert fit.coefficients == pytest.approx(tuple(slope_first[::-1]), rel=1e-9)
    assert fit.std == pytest.approx(tuple(np.sqrt(np.diag(covariance)))[::-1], rel=1e-6)


def test_the_uncertainty_covers_95_of_100_new_readings() -> None:
    raws = [5000.0, 15000.0, 25000.0, 35000.0, 45000.0, 55000.0]
    inside = 0
    for seed in range(400):
        fit = fitted(points_on(LINE, raws, noise=0.1, seed=seed))
        chance = np.random.default_rng(10_000 + seed)
        new = polynomial(LINE, 5000.0) + 0.1 * chance.standard_normal()  # at the end, where it is largest
        inside += abs(new - polynomial(fit.coefficients, 5000.0)) <= fit.uncertainty
    assert 0.92 <= inside / 400 <= 0.98


def test_the_reference_is_part_of_the_uncertainty() -> None:
    points = points_on(LINE, [7000.0, 20000.0, 40000.0, 60000.0], noise=0.02)
    alone, both = fitted(points).uncertainty, fitted(points, reference_uncertainty=0.5).uncertainty
    assert both == pytest.approx(math.hypot(alone, 0.5))


def test_two_points_use_the_scatter_of_the_readings() -> None:
    points = [Point(0.0, (6570.0, 6580.0, 6590.0)), Point(100.0, (59200.0, 59210.0, 59220.0))]
    fit = fitted(points)
    assert fit.residual_std is None
    scatter = 10.0 * fit.coefficients[1]
    assert fit.uncertainty > 2.0 * scatter
    single = fitted([Point(0.0, (6580.0,)), Point(100.0, (59210.0,))])
    assert all(math.isnan(value) for value in single.std)
    assert single.uncertainty < fit.uncertainty


def test_curvature_is_detected_and_a_straight_line_is_not_curved() -> None:
    raws = [float(raw) for raw in range(5000, 65000, 6000)]
    bent = fitted(points_on((0.0, 0.0015, 1e-8), raws, noise=0.05))
    assert bent.bent
    assert not fitted(points_on((0.0, 0.0015, 1e-8), raws, noise=0.05), 2).bent
    calls = [fitted(points_on(LINE, raws, noise=0.05, seed=seed)).bent for seed in range(200)]
    assert sum(calls) <= 8  # 1 % by chance


def test_the_largest_change_of_a_calibration_is_found_within_its_points() -> None:
    fit = fitted(points_on(LINE, [10000.0, 20000.0, 50000.0]))
    assert fit.largest_change((LINE[0] + 1.0, LINE[1])) == pytest.approx(1.0)
    assert fit.largest_change((LINE[0], LINE[1] * 1.01)) == pytest.approx(0.01 * LINE[1] * 50000.0)


@pytest.mark.parametrize(
    ("points", "degree", "message"),
    [
        ([], 1, "too few points"),
        ([Point(1.0, (5.0,))], 1, "too few points"),
        ([Point(1.0, (5.0,)), Point(2.0, (5.0,))], 1, "too few points with different raw values"),
        (points_on(LINE, [1.0, 2.0]), 2, "at least 3 for degree 2"),
        ([Point(1.0, (20000.0,)), Point(2.0, (30000.0,)), Point(1.0, (40000.0,))], 2, "turns back"),
    ],
)
def test_invalid_calibration_points_are_refused(points: list[Point], degree: int, message: str) -> None:
    with pytest.raises(RigctlError, match=message):
        fitted(points, degree)
