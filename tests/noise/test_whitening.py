"""Whitening equals the inverse Cholesky factor of the covariance, gaps and several columns included."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigctl.noise import ChannelNoise, NoiseModel, whiten


def model(*channels: tuple[float, float, float], spacing: float = 0.01) -> NoiseModel:
    return NoiseModel(
        tuple(
            ChannelNoise(f"channel_{i}", sigma, rho, white=white)
            for i, (sigma, rho, white) in enumerate(channels)
        ),
        spacing,
    )


@settings(max_examples=60)
@given(
    rho=st.floats(0.0, 0.98),
    white=st.floats(0.0, 1.0),
    sigma=st.floats(1e-4, 1e4),
    seed=st.integers(0, 2**32 - 1),
)
def test_whitening_equals_the_inverse_cholesky_factor_of_the_covariance(
    rho: float, white: float, sigma: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.integers(1, 4, 40)) * 0.01
    noise = model((sigma, rho, white))
    ok = rng.random((40, 1)) < 0.8
    errors = sigma * rng.standard_normal((40, 1, 3))
    errors[~ok[:, 0]] = np.nan
    whitener = whiten(noise, times, ok)
    kept = ok[:, 0]
    factor = np.linalg.cholesky(noise.channels[0].covariance(times[kept], 0.01))
    expected = np.linalg.solve(factor, errors[kept, 0]) if kept.any() else np.empty((0, 3))
    assert np.allclose(whitener(errors), expected, rtol=1e-6, atol=1e-7)
    assert whitener.log_determinant == pytest.approx(2.0 * np.log(np.diag(factor)).sum(), rel=1e-8, abs=1e-7)


def test_scatter_in_errors_is_the_mean_of_a_joint_normal_distribution_given_them() -> None:
    """Of ``e = C·a + n``, a ~ N(0, 1), by the covariance of all readings: ``C·Cᵀ·(C·Cᵀ + N)⁻¹·e``."""
    rng = np.random.default_rng(4)
    times, noise = 0.01 * np.arange(30), model((2.0, 0.6, 0.3))
    columns = rng.standard_normal((30, 1, 3)) * [5.0, 1.0, 0.2]
    errors = columns @ [1.0, -1.0, 0.5] + 2.0 * rng.standard_normal((30, 1))
    ok = rng.random((30, 1)) < 0.8
    errors[~ok] = np.nan
    kept = ok[:, 0]
    scatter = columns[kept, 0] @ columns[kept, 0].T
    given = np.linalg.solve(scatter + noise.channels[0].covariance(times[kept], 0.01), errors[kept, 0])
    whitener = whiten(noise, times, ok)
    for one in (whitener, whitener.with_scatter(columns)):
        found = one.scatter_in(errors, columns)
        assert found[kept, 0] == pytest.approx(scatter @ given)
        assert np.isfinite(found).all()


def test_rows_are_ordered_by_channel_and_indexed_by_sample() -> None:
    noise = model((1.0, 0.5, 0.0), (2.0, 0.0, 0.0))
    ok = np.array([[True, True], [False, True], [True, False]])
    whitener = whiten(noise, np.array([0.0, 0.01, 0.02]), ok)
    assert whitener.rows.tolist() == [[0, 0], [2, 0], [0, 1], [1, 1]]
    errors = np.array([[1.0, 2.0], [np.nan, 4.0], [3.0, np.nan]])
    across = (3.0 - 0.25 * 1.0) / np.sqrt(1.0 - 0.25**2)
    assert whitener(errors) == pytest.approx([1.0, across, 1.0, 2.0])
    assert np.isnan(errors[1, 0])
    assert errors[2, 0] == 3.0


def test_whitening_accepts_no_columns() -> None:
    """Without right-hand sides LAPACK's `dgttrs` writes past its array; the process may crash at its end."""
    script = (
        "import numpy as np\n"
        "from rigctl.noise.autoregression import innovations\n"
        "for _ in range(50):\n"
        "    assert innovations(np.arange(500.0), 0.9, 0.3)(np.ones((500, 0))).shape == (500, 0)\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, check=False)
    assert done.returncode == 0, done.stderr.decode()


def test_a_block_of_columns_is_whitened_like_each_column() -> None:
    rng = np.random.default_rng(1)
    noise = model((1.0, 0.6, 0.3), (2.0, 0.9, 0.0), (0.5, 0.0, 0.0))
    errors = rng.standard_normal((50, 3, 4))
    whitener = whiten(noise, np.arange(50) * 0.01, rng.random((50, 3)) < 0.9)
    together = whitener(errors)
    assert together.shape == (whitener.size, 4)
    for k in range(4):
        assert np.allclose(together[:, k], whitener(errors[:, :, k]), rtol=1e-12, atol=1e-12)


def test_whitened_noise_is_white() -> None:
    noise = model((1.0, 0.6, 0.4), (2.0, 0.9, 0.0))
    times = np.arange(20000) * 0.01
    rows = whiten(noise, times, np.ones((times.size, 2), bool))(noise.draw(times, np.random.default_rng(2)))
    for z in rows.reshape(2, -1):
        assert np.std(z) == pytest.approx(1.0, abs=0.02)
        assert abs(np.mean(z[1:] * z[:-1])) < 0.02
        assert abs(np.mean(z[5:] * z[:-5])) < 0.02


def test_a_channel_without_samples_gives_no_rows() -> None:
    noise = model((1.0, 0.6, 0.4), (2.0, 0.0, 0.0))
    ok = np.zeros((3, 2), bool)
    ok[:, 1] = True
    assert whiten(noise, np.arange(3.0), ok)(np.ones((3, 2))).tolist() == [0.5, 0.5, 0.5]


def test_equal_times_are_refused() -> None:
    with pytest.raises(ValueError, match="increase"):
        whiten(model((1.0, 0.0, 0.0)), np.array([0.0, 0.0]), np.ones((2, 1), bool))


@pytest.mark.parametrize(("sigma", "rho", "white"), [(0.0, 0.0, 0.0), (1.0, 1.0, 0.0), (1.0, 0.5, 1.5)])
def test_invalid_noise_parameters_are_refused(sigma: float, rho: float, white: float) -> None:
    with pytest.raises(ValueError, match="must"):
        ChannelNoise("x", sigma, rho, white=white)
