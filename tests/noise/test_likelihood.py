"""The restricted likelihood of noise, compared with its formula with whole covariance matrices."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from rigctl.noise.reml import _Likelihood
from rigctl.noise.windows import WindowGroup

Floats = NDArray[np.float64]


def windows(rng: np.random.Generator, samples: int, orders: int, count: int) -> WindowGroup:
    """Windows of noise at irregular times."""
    positions = np.cumsum(rng.integers(1, 4, samples)).astype(float)
    trend = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, samples), orders))[0]
    none = np.zeros(count, dtype=np.intp)
    rows = rng.standard_normal((count, samples))
    return WindowGroup(positions, trend, rows, none, none, np.zeros((count, samples)))


def by_matrices(groups: list[WindowGroup], rho: float, white: float) -> tuple[float, float]:
    """Σ (ln|R| + ln|XᵀR⁻¹X|) and Q as defined at `fit_noise`."""
    determinant = quadratic = 0.0
    for group in groups:
        apart = np.abs(group.positions[:, None] - group.positions)
        covariance = (1.0 - white) * rho**apart + white * np.eye(apart.shape[0])
        inverse = np.linalg.inv(covariance)
        normal = group.trend.T @ inverse @ group.trend
        logarithms = np.linalg.slogdet(covariance)[1] + np.linalg.slogdet(normal)[1]
        determinant += group.rows.shape[0] * float(logarithms)
        hat = inverse @ group.trend @ np.linalg.solve(normal, group.trend.T @ inverse)
        quadratic += sum(float(row @ (inverse - hat) @ row) for row in group.rows)
    return determinant, quadratic


@pytest.mark.parametrize("white", [0.0, 0.1, 0.6, 0.99, 1.0])
@pytest.mark.parametrize("rho", [0.0, 0.2, 0.7, 0.98])
def test_the_likelihood_agrees_with_whole_covariance_matrices(rho: float, white: float) -> None:
    rng = np.random.default_rng(4)
    shapes = [(8, 1, 3), (25, 3, 60), (12, 4, 1), (2, 1, 5)]
    groups = [windows(rng, *shape) for shape in shapes]
    assert _Likelihood(groups)(rho, white) == pytest.approx(by_matrices(groups, rho, white), rel=1e-9)
