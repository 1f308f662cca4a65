"""Does the model agree with the data within the noise? Three tests, all of which must pass.

Also the variance factor of what an inadequate model leaves, by which differences between models count less.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.levels import ALPHA, BELOW_NOISE, QUANTILE
from rigctl.analysis.nuisance_projection import Projected
from rigctl.analysis.score_test import Screening
from rigctl.model.fit.errors import whitened_residual
from rigctl.model.fit.fit import FitResult

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Test:
    """One test: its statistic and how often chance alone reaches it.

    Attributes
    ----------
    dof: degrees of freedom; 0 where the statistic has none.
    spread: standard deviation of the statistic when nothing is missing.
    known: degrees of freedom behind the noise of a table's rows; 0 where the noise counts as known.
    """

    statistic: float
    p_value: float
    dof: int = 0
    spread: float = 0.0
    known: int = 0

    __test__ = False  # not a test case

    @property
    def excess(self) -> float:
        """What of the statistic chance does not explain, in χ²; 0 where it has no degrees of freedom.

        Of a table, whose noise is known from few rows, chance explains
        ``dof·F⁻¹(1 − ALPHA; dof, known)``.
        """
        if not self.dof:
            return 0.0
        if self.known:
            return max(0.0, self.statistic - self.dof * _quantile(self.dof, self.known))
        return max(0.0, self.statistic - self.dof - QUANTILE * self.spread)


@dataclass(frozen=True)
class Adequacy:
    """The three tests together.

    Attributes
    ----------
    tests: ``score`` (the largest candidate's), ``plane`` (residuals of each phase and channel over the
        operating point), ``chi2`` (the whole misfit).
    p_value: Holm's smallest: three times the smallest of them.
    below_noise: a test rejects, and yet the error of every channel is smaller than its noise: the noise is
        not what was learned (slower, or narrower here), and the tests, which rest on it, say nothing.
    agrees: no test rejects.
    adequate: no test rejects, or none can be believed; it ends a search, and says nothing of what explains.
    """

    tests: dict[str, Test]
    below_noise: bool = False

    @property
    def p_value(self) -> float:
        """Holm over the tests that could be made."""
        return min(1.0, len(self.tests) * min(test.p_value for test in self.tests.values()))

    @property
    def agrees(self) -> bool:
        """True when no test rejects: p_value is not below `ALPHA`."""
        return self.p_value >= ALPHA

    @property
    def adequate(self) -> bool:
        """True when no test rejects, or none can be believed."""
        return self.agrees or self.below_noise


def adequacy(projected: Projected, screening: Screening) -> Adequacy:
    """Test a fitted model; the candidates' largest score is in `screening`."""
    tests = {"plane": plane_test(projected), "chi2": chi2_test(projected)}
    if screening.scores:
        tests = {"score": Test(screening.statistic, screening.p_value), **tests}
    judged = Adequacy(
        {name: test for name, test in tests.items() if name == "chi2" or test.dof or name == "score"}
    )
    if judged.agrees or projected.linearisation.fit.problem.measurements.table:
        return judged
    return replace(judged, below_noise=error_below(projected.linearisation.fit, BELOW_NOISE))


def error_below(fit: FitResult, share: float) -> bool:
    """Whether every channel's error is at most this share of its noise.

    A right model's is as large as the noise, as far as that is known: below `BELOW_NOISE` the noise is not
    what it was taken for.
    """
    return all(error.nrmse <= share for error in fit.errors.values())


def plane_test(projected: Projected) -> Test:
    """Whitened residuals summed over each phase and channel, regressed on {1, T, p, T·p, …}.

    With M the regressors in whitened rows, ``χ² = r̃ᵀM̃(M̃ᵀM̃)⁺M̃ᵀr̃``, M̃ = (I − P_J)M.
    """
    lin = projected.linearisation
    columns = np.vstack([_outer(lin.records[k].regions, lin.regions.plane(k)) for k in projected.records])
    left = projected.project(columns)
    lengths = np.linalg.norm(left, axis=0)
    whole = np.linalg.norm(columns, axis=0)
    good = lengths > 1e-3 * np.where(whole > 0.0, whole, 1.0)
    good &= whole > 0.0
    if not good.any():
        return Test(0.0, 1.0, 0)
    span, values, _ = np.linalg.svd(left[:, good] / lengths[good], full_matrices=False)
    span = span[:, values > 1e-3 * values[0]]
    statistic = float(np.square(span.T @ projected.residual).sum())
    dof, known = span.shape[1], projected.noise_degrees
    return Test(statistic, chi2_tail(statistic, dof, known), dof, math.sqrt(2.0 * dof), known)


def chi2_test(projected: Projected) -> Test:
    """``χ² = r̃ᵀr̃``, its variance widened by how well the noise itself is known."""
    lin = projected.linearisation
    statistic = float(projected.residual @ projected.residual)
    dof = projected.dof
    if dof <= 0:
        return Test(statistic, 1.0, 0)
    if projected.noise_degrees:
        known = projected.noise_degrees
        return Test(statistic, chi2_tail(statistic, dof, known), dof, known=known)
    extra = 0.0
    problem = lin.fit.problem.only(lin.fit.fitted)
    for c, channel in enumerate(problem.noise.channels):
        count = sum(int(problem.ok[k][:, c].sum()) for k in projected.records)
        if channel.degrees:  # count·F(count, degrees) has this variance beyond that of χ²(count)
            extra += 2.0 * count**2 / channel.degrees
    spread = math.sqrt(2.0 * dof + extra)
    if extra == 0.0:
        return Test(statistic, chi2_tail(statistic, dof), dof, spread)
    z = (statistic - dof) / spread
    return Test(statistic, 0.5 * math.erfc(z / math.sqrt(2.0)), dof, spread)


def chi2_tail(statistic: float, dof: int, known: int = 0) -> float:
    """Chance that χ² with `dof` degrees of freedom is at least `statistic`.

    With `known` degrees of freedom behind the noise, that of ``dof·F(dof, known)``.
    """
    from scipy.special import fdtrc, gammaincc

    if known:
        return float(fdtrc(dof, known, max(statistic, 0.0) / dof))
    return float(gammaincc(0.5 * dof, 0.5 * max(statistic, 0.0)))


def _quantile(dof: int, known: int) -> float:
    """Of F(dof, known), what chance exceeds with probability `ALPHA`."""
    from scipy.special import fdtri

    return float(fdtri(dof, known, 1.0 - ALPHA))


def _outer(regions: Floats, plane: Floats) -> Floats:
    """(rows, columns·basis)."""
    return np.asarray((regions[:, :, None] * plane).reshape(regions.shape[0], -1))


#: lags that are summed: up to this share of a record
_LAGS = 0.25


def variance_factor(fit: FitResult) -> float:
    """The long-run variance of the whitened residuals, no less than 1: 1 where a model leaves noise alone.

    ``φ = c_0 + 2·Σ_(k ≤ K) (1 − k/(K + 1))·c_k``, c_k the autocovariance at lag k of the residuals of each
    channel of each record, over all fitted ones; K is a quarter of the longest. What is left of a model that
    is not right in any case (another shape, a slow drift) has a larger variance than the noise, and is slow:
    its readings are not independent, and a difference of χ² between two such models counts as 1/φ of itself.

    Source: Newey & West, Econometrica 55 (1987) 703; Burnham & Anderson, *Model Selection and Multimodel
    Inference* (2002), §2.5.
    """
    series = _by_channel(fit)
    if not series:
        return 1.0
    most = int(_LAGS * max(one.size for one in series))
    sums = np.zeros(most + 1)
    for one in series:
        covariances = _autocovariance(one)[: most + 1]
        sums[: covariances.size] += covariances
    covariance = sums / sum(one.size for one in series)
    weights = 1.0 - np.arange(1, most + 1) / (most + 1.0)
    return max(1.0, float(covariance[0]), float(covariance[0] + 2.0 * weights @ covariance[1:]))


def _by_channel(fit: FitResult) -> list[NDArray[np.float64]]:
    """The whitened residuals of each channel of each fitted record, in time."""
    series = []
    for index in fit.fitted:
        white = whitened_residual(fit.problem, fit.outputs[index], index)
        channel = fit.problem.whiteners[index].rows[:, 1]
        series += [white[channel == one] for one in np.unique(channel)]
    return [one for one in series if one.size]


def _autocovariance(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sums of the products of values k apart, for k from 0."""
    padded = np.fft.rfft(values, 2 * values.size)
    return np.asarray(np.fft.irfft(np.abs(padded) ** 2, 2 * values.size)[: values.size])


_LEAST = 1e-6


def chance(p_value: float) -> str:
    """``0.03``, or ``< 1e-6``."""
    return "< 1e-6" if p_value < _LEAST else f"{p_value:.2g}"


def chance_text(p_value: float) -> str:
    """``p = 0.03``, or ``p < 1e-6``."""
    return f"p {chance(p_value)}" if p_value < _LEAST else f"p = {chance(p_value)}"
