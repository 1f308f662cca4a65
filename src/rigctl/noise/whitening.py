"""Whitening: residuals of a record with the noise's correlation removed, of unit variance in each row.

In: the noise model, and the times and samples of one record. Out: a `Whitener`, W in ``r = W·(y − f)`` and
``J = W·∂f/∂θ``. With it every fit is ordinary least squares, and every statistic is in sigmas.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rigctl.noise.autoregression import Innovations, innovations
from rigctl.noise.noise_model import NoiseModel


@dataclass(frozen=True)
class _ChannelWhitener:
    """One channel of one record: the samples used, and the innovations of its noise."""

    samples: NDArray[np.intp]
    sigma: NDArray[np.float64]
    innovations: Innovations

    def __call__(self, errors: NDArray[np.float64]) -> NDArray[np.float64]:
        sigma = self.sigma[(slice(None),) + (None,) * (errors.ndim - 1)]
        used = errors if self.samples.size == len(errors) else errors[self.samples]
        return self.innovations(used / sigma)


#: scatter below this share of the noise is ignored
_SEEN = 0.05


@dataclass(frozen=True)
class _Scatter:
    """``1 − U·diag(f)·Uᵀ``, U orthonormal: directions in which rows vary by more than the noise."""

    directions: NDArray[np.float64]
    shares: NDArray[np.float64]

    def __call__(self, white: NDArray[np.float64]) -> NDArray[np.float64]:
        along = self.directions.T @ white
        shares = self.shares[(slice(None),) + (None,) * (along.ndim - 1)]
        return white - self.directions @ (shares * along)


@dataclass(frozen=True)
class Whitener:
    """Whitens errors or sensitivities of one record; made by `whiten`.

    Parameters
    ----------
    rows: (rows, 2) sample index and channel index of each row: channel after channel, in order of time.
    log_determinant: ln of the determinant of the covariance of the kept samples, so that
        ``−2·ln likelihood = Σ z² + log_determinant + rows·ln 2π``.
    """

    rows: NDArray[np.intp]
    log_determinant: float
    _channels: tuple[_ChannelWhitener, ...]
    _scatter: _Scatter | None = None

    @property
    def size(self) -> int:
        """The number of rows."""
        return int(self.rows.shape[0])

    def __call__(self, errors: NDArray[np.float64]) -> NDArray[np.float64]:
        """Whitened rows of errors (n, channels) or (n, channels, k): (rows) or (rows, k).

        Values at samples left out, including NaN, do not matter.
        """
        if errors.ndim not in (2, 3) or errors.shape[1] != len(self._channels):
            raise ValueError(f"expected (samples, {len(self._channels)}[, k]), got {errors.shape}")
        white = np.concatenate([each(errors[:, i]) for i, each in enumerate(self._channels)], axis=0)
        return white if self._scatter is None else self._scatter(white)

    def with_scatter(self, columns: NDArray[np.float64]) -> Whitener:
        """The whitener for this noise plus ``Σ a_k·columns_k`` with unknown a_k ~ N(0, 1).

        With D the whitened columns, ``z = (1 + D·Dᵀ)^(−½)·W·e``: known scatter that is not an unknown of its
        own costs no degree of freedom.

        Parameters
        ----------
        columns: (n, channels, k), for one standard deviation each.
        """
        # D = U·diag(s)·Vᵀ: (1 + DDᵀ)^(−½) = 1 − U·diag(1 − 1/√(1 + s²))·Uᵀ. Directions of hardly any scatter
        # are dropped.
        left, values, _ = np.linalg.svd(replace(self, _scatter=None)(columns), full_matrices=False)
        significant = values > _SEEN
        if not significant.any():
            return self
        values = values[significant]
        scatter = _Scatter(left[:, significant], 1.0 - 1.0 / np.sqrt(1.0 + values**2))
        more = float(np.sum(np.log1p(values**2)))
        return replace(self, log_determinant=self.log_determinant + more, _scatter=scatter)

    def scatter_in(self, errors: NDArray[np.float64], columns: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, channels) the part of errors (n, channels) that is most likely scatter, ``Σ â_k·columns_k``.

        ``â = (1 + DᵀD)⁻¹·Dᵀ·W·e``, D the whitened columns: the mean of a_k ~ N(0, 1) given the errors. Values
        at samples left out, including NaN, do not matter.
        """
        alone = replace(self, _scatter=None)
        white = alone(columns)
        sizes = np.linalg.solve(np.eye(white.shape[1]) + white.T @ white, white.T @ alone(errors))
        return np.asarray(columns @ sizes)


def whiten(
    noise: NoiseModel,
    times: NDArray[np.float64],
    ok: NDArray[np.bool_],
    values: NDArray[np.float64] | None = None,
    extra: NDArray[np.float64] | None = None,
    sigma: NDArray[np.float64] | None = None,
) -> Whitener:
    """The whitener of one record.

    For a channel without white noise each row is the autoregression's innovation, across gaps too:
    ``z_i = (e_i − r_i·e_(i−1))/(σ·√(1 − r_i²))`` with ``r_i = ρ^(Δt_i/spacing)`` and i − 1 the sample
    kept before i; the first is ``e_0/σ``. With white noise on top the differences ``e_i − r_i·e_(i−1)`` are
    themselves correlated with their neighbours; they are divided by the Cholesky factor of their tridiagonal
    covariance, which makes z the innovations of the Kalman filter of that noise.

    Parameters
    ----------
    noise: of all channels.
    times: (n) s, increasing.
    ok: (n, channels) the samples to use: finite, and not spikes.
    values: (n, channels) SI, the readings; needed only for noise that is a share of the value.
    extra: (channels) SI, standard deviation of additional noise of each channel.
    sigma: (n, channels) SI, the standard deviation of the noise of each reading, if already known.

    Returns
    -------
    a whitener with one row for each True value of `ok`; ``Var z = 1`` if the noise is as stated.

    Raises
    ------
    ValueError
        inconsistent shapes, or times that do not increase.

    Source: Harvey, *Forecasting, Structural Time Series Models and the Kalman Filter* (1989), §3.
    """
    if ok.shape != (times.size, len(noise.channels)):
        raise ValueError(f"expected a mask of {(times.size, len(noise.channels))}, got {ok.shape}")
    if times.size > 1 and not np.all(np.diff(times) > 0.0):
        raise ValueError("times must increase inside a record")
    if values is None:
        values = np.zeros(ok.shape)
    each = []
    for i, channel in enumerate(noise.channels):
        # Channels are independent of each other: each is scaled by its σ and freed of its correlation by
        # itself. A gap needs no special treatment, as the correlation follows from the times.
        samples = np.flatnonzero(ok[:, i])
        positions = times[samples] / noise.spacing
        size = channel.sigma_at(values[samples, i]) if sigma is None else sigma[samples, i]
        if extra is not None and extra[i] > 0.0:
            size = np.hypot(size, extra[i])
        each.append(
            _ChannelWhitener(samples, size, innovations(positions, channel.correlation, channel.white))
        )
    rows = np.concatenate(
        [np.column_stack([one.samples, np.full(one.samples.size, i)]) for i, one in enumerate(each)]
    )
    log_determinant = sum(
        one.innovations.log_determinant + 2.0 * float(np.sum(np.log(one.sigma))) for one in each
    )
    return Whitener(rows.astype(np.intp), log_determinant, tuple(each))
