"""First-order autoregression with white noise on top: the bidiagonal factor that whitens it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

#: smaller correlations count as zero
_NO_CORRELATION = 1e-9


@dataclass(frozen=True)
class Innovations:
    """The transformation of noise of unit variance into its innovations, uncorrelated and of unit variance.

    The differences ``u_i = e_i − r_i·e_(i−1)``, ``r_i = ρ^(Δt_i)``, of noise with the covariance
    ``(1 − w)·ρ^|t_i − t_j| + w·[i = j]`` have a tridiagonal covariance ``L·D·Lᵀ``: on its diagonal
    ``(1 − w)·(1 − r_i²) + w·(1 + r_i²)``, beside it ``−w·r_(i+1)``. L is unit lower bidiagonal.

    Parameters
    ----------
    kept: r (one less than the samples); empty for white noise.
    root: (samples) the square root of D.
    below: the subdiagonal of L (one less than the samples); None when w = 0.
    """

    kept: NDArray[np.float64]
    root: NDArray[np.float64]
    below: NDArray[np.float64] | None

    @property
    def log_determinant(self) -> float:
        """Logarithm of the determinant of the covariance matrix."""
        return 2.0 * float(np.sum(np.log(self.root)))

    def __call__(self, errors: NDArray[np.float64]) -> NDArray[np.float64]:
        """``D^(−½)·L⁻¹·u`` of errors (samples) or (samples, k); a new array."""
        down = (slice(None),) + (None,) * (errors.ndim - 1)
        u = errors.copy()
        if self.kept.size:
            u[1:] -= self.kept[down] * errors[:-1]
        if self.below is None:
            u /= self.root[down]
            return u
        return _forward(self.root, self.below, u)


def has_correlation(correlation: float, white: float) -> bool:
    """Whether noise of this correlation and white share differs from white noise."""
    return correlation >= _NO_CORRELATION and white != 1.0


def innovations(positions: NDArray[np.float64], correlation: float, white: float) -> Innovations:
    """The innovations of noise sampled at `positions`, in units of the spacing of `correlation`."""
    if positions.size < 2 or not has_correlation(correlation, white):
        return Innovations(np.empty(0), np.ones(positions.size), None)
    correlations = correlation ** np.diff(positions)
    variance = np.ones(positions.size)
    variance[1:] = (1.0 - white) * (1.0 - correlations**2) + white * (1.0 + correlations**2)
    if white == 0.0:
        return Innovations(correlations, np.sqrt(variance), None)
    from scipy.linalg.lapack import dpttrf

    diagonal, subdiagonal, _ = dpttrf(variance, -white * correlations)
    return Innovations(correlations, np.sqrt(diagonal), subdiagonal)


def _forward(
    root: NDArray[np.float64], below: NDArray[np.float64], u: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Solve L·D^½·z = u: a tridiagonal elimination that is already done, with nothing above the diagonal.

    The triangular solvers for band matrices start threads, which costs more than these few operations; the
    tridiagonal one does not.
    """
    size = root.size
    if size < 3:
        z = u / root[(slice(None),) + (None,) * (u.ndim - 1)]
        z[1] -= below[0] * u[0] / root[1]
        return np.asarray(z)
    if u.size == 0:  # a model without derivatives; dgttrs corrupts the heap without columns
        return u
    from scipy.linalg.lapack import dgttrs

    order = np.arange(1, size + 1, dtype=np.int32)
    flat = u.reshape(size, -1)
    z, _ = dgttrs(below, root, np.zeros(size - 1), np.zeros(size - 2), order, flat)
    return np.asarray(z).reshape(u.shape)
