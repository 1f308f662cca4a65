"""The predicted power against repeated simulated experiments."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.stats import norm

from rigctl.design.information import Refit, Response
from rigctl.design.power import Gain, detection_power, gain, power_to_distinguish, threshold_of

Floats = NDArray[np.float64]
Model = Callable[[Floats, Floats], Floats]

#: two laws of decay: nearly alike over the old points, less so over the new ones
OLD, NEW = np.linspace(0.0, 1.2, 40), np.linspace(0.0, 4.0, 30)
TRUTH = np.array([6.0, 0.8])


def exponential(theta: Floats, x: Floats) -> Floats:
    return np.asarray(theta[0] * np.exp(-theta[1] * x))


def hyperbolic(theta: Floats, x: Floats) -> Floats:
    return np.asarray(theta[0] / (1.0 + theta[1] * x))


def fitted(model: Model, x: Floats, y: Floats) -> tuple[Floats, float]:
    found = least_squares(lambda theta: model(theta, x) - y, TRUTH, x_scale=TRUTH)
    return found.x, 2.0 * float(found.cost)


def slopes(model: Model, theta: Floats, x: Floats) -> Floats:
    step = 1e-6
    return np.stack(
        [(model(theta + step * e, x) - model(theta - step * e, x)) / (2.0 * step) for e in np.eye(2)], axis=1
    )


def expected(y: Floats) -> tuple[Gain, float]:
    """The gain of the exponential over the hyperbola by new data, from old data alone; and L₀."""
    (right, chi2), (rival, other) = fitted(exponential, OLD, y), fitted(hyperbolic, OLD, y)
    known = [
        columns.T @ columns for columns in (slopes(exponential, right, OLD), slopes(hyperbolic, rival, OLD))
    ]
    rng = np.random.default_rng(1)
    draws = rng.multivariate_normal(right, np.linalg.inv(known[0]), 200)
    truths = np.stack([exponential(draw, NEW) for draw in draws], axis=1)
    responses = [
        Response(model(theta, NEW), slopes(model, theta, NEW), np.zeros((NEW.size, 0)))
        for model, theta in ((exponential, right), (hyperbolic, rival))
    ]
    refits = [Refit.of([one], info) for one, info in zip(responses, known, strict=True)]
    away = [truths - one.predicted[:, None] for one in responses]
    left = [refit.left(one) for refit, one in zip(refits, away, strict=True)]
    return gain(away[0], left[0], away[1], left[1]), other - chi2


def test_the_predicted_gain_of_a_nonlinear_pair_agrees_with_refits_of_all_data() -> None:
    """Repeated campaigns: the mean predicted gain agrees with the mean realised one, and the mean predicted
    probability with the share of campaigns that pass the threshold."""
    rng = np.random.default_rng(7)
    predicted, realised, passed, promised = [], [], [], []
    for _ in range(120):
        old = exponential(TRUTH, OLD) + rng.normal(size=OLD.size)
        gained, margin = expected(old)
        new = exponential(TRUTH, NEW) + rng.normal(size=NEW.size)
        both = np.concatenate([OLD, NEW]), np.concatenate([old, new])
        now = fitted(hyperbolic, *both)[1] - fitted(exponential, *both)[1]
        predicted.append(float(gained.mean.mean()))
        realised.append(now - margin)
        passed.append(now >= 9.2)
        deviates = (margin + gained.mean - 9.2) / (2.0 * np.sqrt(gained.variance))
        promised.append(float(norm.cdf(deviates).mean()))
    scatter = np.std(realised) / np.sqrt(len(realised))
    assert np.mean(predicted) == pytest.approx(np.mean(realised), abs=4.0 * scatter + 0.1 * np.mean(realised))
    assert np.mean(promised) == pytest.approx(np.mean(passed), abs=0.12)


def test_two_names_of_one_law_have_no_gain_however_uncertain_their_parameters() -> None:
    """Without refitting the true model too, draws would predict a gain equal to its degrees of freedom."""
    rng = np.random.default_rng(2)
    columns = rng.normal(size=(50, 3))
    same = Response(rng.normal(size=50), columns, np.zeros((50, 0)))
    refit = Refit.of([same], 0.1 * np.eye(3))
    truths = same.predicted[:, None] + columns @ rng.normal(size=(3, 100)) * 3.0
    away = truths - same.predicted[:, None]
    found = gain(away, refit.left(away), away, refit.left(away))
    assert np.abs(found.mean).max() < 1e-9
    assert power_to_distinguish(found, margin=0.0, so_far=100.0) == 0.0


def test_the_power_for_known_parameters_is_the_normal_probability() -> None:
    gained = Gain(np.array([40.0]), np.array([40.0]))
    assert power_to_distinguish(gained, 2.0, so_far=10.0) == pytest.approx(
        norm.cdf((2.0 + 40.0 - 9.2) / (2.0 * np.sqrt(40.0)))
    )


def test_the_power_requires_the_least_separation_too() -> None:
    """A verdict needs a separation besides the odds: a D of 12 passes the odds in 66 cases of 100, and the
    least separation in hardly any."""
    gained = Gain(np.array([12.0]), np.array([12.0]))
    assert power_to_distinguish(gained, 0.0, so_far=0.0) < 0.01
    assert power_to_distinguish(gained, 0.0, so_far=20.0) == pytest.approx(
        norm.cdf(2.8 / (2.0 * np.sqrt(12.0)))
    )


def test_the_threshold_of_a_large_effect_grows_with_its_size() -> None:
    assert threshold_of(100.0) == 9.2
    assert threshold_of(5000.0) == pytest.approx(50.0)


def test_the_power_to_detect_an_effect_agrees_with_simulated_scores() -> None:
    rng = np.random.default_rng(3)
    scores = np.square(rng.normal(4.0, 1.0, 40_000))
    asked = norm.isf(0.01 / 40 / 2.0) ** 2
    assert detection_power(16.0, 1, 40) == pytest.approx(np.mean(scores > asked), abs=0.01)
    assert detection_power(0.0, 1, 40) == pytest.approx(0.01 / 40, rel=1e-3)
