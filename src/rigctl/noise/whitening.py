"""Whitening: residuals of a record with the noise's correlation taken out, one unit of variance per row."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.noise.noise_model import ChannelNoise, NoiseModel

#: correlations below this are not worth a difference
_NO_CORRELATION = 1e-9


@dataclass(frozen=True)
class _ChannelWhitener:
    """One channel of one record: the samples it keeps, and the bidiagonal factors of its covariance.

    The autoregressive difference ``u_i = e_i − r_i·e_(i−1)`` has a tridiagonal covariance ``G·Gᵀ``; `kept`
    holds r (one less than the samples), `diagonal` and `below` the lower bidiagonal G. Without white noise G
    is diagonal.
    """

    samples: NDArray[np.intp]
    kept: NDArray[np.float64]
    diagonal: NDArray[np.float64]
    below: NDArray[np.float64] | None

    def __call__(self, errors: NDArray[np.float64]) -> NDArray[np.float64]:
        """G⁻¹·u of errors (n) or (n, k)."""
        taken = errors[self.samples]
        down = (slice(None),) + (None,) * (taken.ndim - 1)
        if self.kept.size:
            # the right-hand side is formed whole before it is stored, so nothing is read after it changed
            taken[1:] -= self.kept[down] * taken[:-1]
        if self.below is None:
            taken /= self.diagonal[down]
            return taken
        from scipy.linalg.lapack import dtbtrs

        banded = np.stack([self.diagonal, np.append(self.below, 0.0)])
        flat = taken.reshape(taken.shape[0], -1)
        solved, _ = dtbtrs(banded, flat, uplo="L")
        return np.asarray(solved).reshape(taken.shape)


@dataclass(frozen=True)
class Whitener:
    """Whitens errors or sensitivities of one record; made by `whiten`.

    Parameters
    ----------
    rows: (rows, 2) sample index and channel index of each row: channel after channel, in time.
    log_determinant: ln of the determinant of the covariance of the kept samples, so that
        ``−2·ln likelihood = Σ z² + log_determinant + rows·ln 2π``.
    """

    rows: NDArray[np.intp]
    log_determinant: float
    _channels: tuple[_ChannelWhitener, ...]

    @property
    def size(self) -> int:
        """The number of rows."""
        return int(self.rows.shape[0])

    def __call__(self, errors: NDArray[np.float64]) -> NDArray[np.float64]:
        """Whitened rows of errors (n, channels) or (n, channels, k): (rows) or (rows, k).

        What stands at samples left out, NaN included, does not matter.
        """
        if errors.ndim not in (2, 3) or errors.shape[1] != len(self._channels):
            raise ValueError(f"expected (samples, {len(self._channels)}[, k]), got {errors.shape}")
        return np.concatenate([each(errors[:, i]) for i, each in enumerate(self._channels)], axis=0)


def whiten(noise: NoiseModel, times: NDArray[np.float64], ok: NDArray[np.bool_]) -> Whitener:
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
    ok: (n, channels) the samples to keep: finite, and no spike.

    Returns
    -------
    a whitener with one row for each true value of `ok`; ``Var z = 1`` when the noise is as stated.

    Raises
    ------
    ValueError
        shapes that do not belong together, or times that do not increase.

    Source: Harvey, *Forecasting, Structural Time Series Models and the Kalman Filter* (1989), §3.
    """
    if ok.shape != (times.size, len(noise.channels)):
        raise ValueError(f"expected a mask of {(times.size, len(noise.channels))}, got {ok.shape}")
    if times.size > 1 and not np.all(np.diff(times) > 0.0):
        raise ValueError("times must increase inside a record")
    each = tuple(
        _channel_whitener(channel, times, np.flatnonzero(ok[:, i]), noise.spacing)
        for i, channel in enumerate(noise.channels)
    )
    rows = np.concatenate(
        [np.column_stack([one.samples, np.full(one.samples.size, i)]) for i, one in enumerate(each)]
    )
    log_determinant = 2.0 * sum(float(np.sum(np.log(one.diagonal))) for one in each)
    return Whitener(rows.astype(np.intp), log_determinant, each)


def _channel_whitener(
    channel: ChannelNoise, times: NDArray[np.float64], samples: NDArray[np.intp], spacing: float
) -> _ChannelWhitener:
    count = samples.size
    if count < 2 or channel.correlation < _NO_CORRELATION or channel.white == 1.0:
        return _ChannelWhitener(samples, np.empty(0), np.full(count, channel.sigma), None)
    kept = channel.correlation ** (np.diff(times[samples]) / spacing)
    coloured = channel.sigma**2 * (1.0 - channel.white)
    white = channel.sigma**2 * channel.white
    variance = np.empty(count)
    variance[0] = channel.sigma**2
    variance[1:] = coloured * (1.0 - kept**2) + white * (1.0 + kept**2)
    if white == 0.0:
        return _ChannelWhitener(samples, kept, np.sqrt(variance), None)
    return _ChannelWhitener(samples, kept, *_bidiagonal(variance, -kept * white))


def _bidiagonal(
    variance: NDArray[np.float64], covariance: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Cholesky factor of a tridiagonal matrix: its diagonal (n) and what stands below it (n − 1)."""
    from scipy.linalg.lapack import dpttrf

    diagonal, below, _ = dpttrf(variance, covariance)
    root = np.sqrt(diagonal)
    return root, below * root[:-1]
