"""Does the model agree with the data within the noise? Up to four tests, none of which may reject.

In: a linearisation with the fitted unknowns projected off, and the scores of the library. Out: `Adequacy`.
No test sees everything: `score` what an effect of the library would remove, `plane` what changes with the
operating point, ``chi2`` any misfit if it is large, ``inputs`` errors that follow a past input, where no
noise level is known. That none rejects is no agreement yet: channels whose noise is not known are `unproven`
until their errors are shown to be noise.

Also the variance factor of the residuals of an inadequate model, by which differences between models are
discounted.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.agreement.sensors import SensorBudget, sensor_budget
from rigctl.analysis.decision_levels import ALPHA, BELOW_NOISE, LEAST_EXPLAINED, QUANTILE
from rigctl.analysis.linear.chi_square import chi2_tail
from rigctl.analysis.linear.nuisance_projection import Projected
from rigctl.analysis.linear.residual_analysis import Correlations, residual_correlations
from rigctl.analysis.linear.score_test import Screening
from rigctl.model.fit.errors import whitened_residual
from rigctl.model.fit.fit import FitResult
from rigctl.noise import ChannelNoise

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Test:
    """One test: its statistic and its p-value.

    Attributes
    ----------
    dof: degrees of freedom; 0 if the statistic has none.
    spread: standard deviation of the statistic when nothing is missing.
    known: degrees of freedom of a noise that is estimated from few rows of a table, or guessed; 0 if it
        counts as known.
    """

    statistic: float
    p_value: float
    dof: int = 0
    spread: float = 0.0
    known: int = 0

    __test__ = False  # not a test case

    @property
    def excess(self) -> float:
        """The part of the statistic that chance does not explain, in χ²; 0 without degrees of freedom.

        Where the noise has only `known` degrees of freedom, chance explains
        ``dof·F⁻¹(1 − ALPHA; dof, known)``.
        """
        if not self.dof:
            return 0.0
        if self.known:
            return max(0.0, self.statistic - self.dof * _quantile(self.dof, self.known))
        return max(0.0, self.statistic - self.dof - QUANTILE * self.spread)


@dataclass(frozen=True)
class Adequacy:
    """The tests together.

    Attributes
    ----------
    tests: ``score`` (the largest of all candidates), ``plane`` (residuals of each phase and channel regressed
        on the operating point), ``chi2`` (the total misfit).
    p_value: smallest p-value times the number of tests (Bonferroni; the first step of Holm's procedure).
    below_noise: a test rejects although the error of every channel is smaller than its noise: the noise
        differs from the one learned (slower, or smaller here), and the tests, which rest on it, are invalid.
    unproven: channels whose errors may be slow noise or a missing effect: only the white floor of their noise
        is known, or not even that, and the errors are not white at that floor.
    stated: channels whose errors are not white at the floor either, but within the noise that the rig file
        states.
    unusable: channels of which the rig file states a noise that is far from the data: nothing can be decided.
    sensors: the errors of calibrations and clocks; None if no uncertainty is stated.
    misread: channels whose calibration, and clocks that, would have to be wrong by more than the rig file
        states.
    agrees: no test rejects, no channel is unproven, and none is misread.
    adequate: the model agrees, or no test can be trusted; ends a search, but does not say what explains the
        data.
    undecided: no test rejects, but agreement is not shown either.
    """

    tests: dict[str, Test]
    below_noise: bool = False
    unproven: tuple[str, ...] = ()
    stated: tuple[str, ...] = ()
    unusable: tuple[str, ...] = ()
    sensors: SensorBudget | None = None

    @property
    def p_value(self) -> float:
        """Smallest p-value times the number of tests that could be made."""
        return min(1.0, len(self.tests) * min(test.p_value for test in self.tests.values()))

    @property
    def rejected(self) -> bool:
        """True if a test rejects: p_value is below `ALPHA`."""
        return self.p_value < ALPHA

    @property
    def misread(self) -> tuple[str, ...]:
        """The channels and clocks that are more wrong than their calibrations allow, or what is stated."""
        return () if self.sensors is None else tuple(one.of[1] for one in self.sensors.beyond)

    @property
    def agrees(self) -> bool:
        """True if no test rejects, and no channel's errors may be slow noise, or a sensor's, or a missing
        effect."""
        return not self.rejected and not self.unproven and not self.unusable and not self.misread

    @property
    def only_misread(self) -> bool:
        """True if nothing but errors of sensors, larger than stated, speaks against the model."""
        return bool(self.misread) and not (self.rejected or self.unproven or self.unusable)

    @property
    def adequate(self) -> bool:
        """True if the model agrees, or no test can be trusted."""
        return self.agrees or self.below_noise

    @property
    def undecided(self) -> bool:
        """True if neither agreement nor disagreement is shown."""
        return bool(self.unusable) or (bool(self.unproven) and not self.rejected)

    @property
    def verdict(self) -> bool | None:
        """Whether the model is adequate; None if these data cannot tell."""
        return None if self.undecided or self.below_noise else self.agrees


def adequacy(projected: Projected, screening: Screening) -> Adequacy:
    """Test a fitted model; `screening` holds the largest score of the candidates."""
    fit = projected.linearisation.fit
    tests = {"plane": plane_test(projected), "chi2": chi2_test(projected)}
    if screening.scores:
        tests = {"score": Test(screening.statistic, screening.p_value), **tests}
    tests = {name: test for name, test in tests.items() if name == "chi2" or test.dof or name == "score"}
    # A table has no order in time: neither its noise nor its errors have a correlation that could be tested.
    sensors = sensor_budget(fit)
    if fit.problem.measurements.table:
        return Adequacy(tests, sensors=sensors)
    floors = [channel for channel in fit.problem.noise.channels if channel.own_scale]
    found = residual_correlations(fit) if floors else {}
    if floors:
        # what a model leaves is its own scale there: χ² has its expectation whatever is missing, and the
        # correlation with past inputs takes its place, which needs no noise level
        tests |= {"inputs": _inputs_test([found[one.name] for one in floors if one.name in found])}
        if len(floors) == len(fit.problem.noise.channels):
            del tests["chi2"]
    # Tests can only reject. That errors are noise has to be shown for each channel whose noise is not known:
    # white at the floor, or within what the rig file states.
    open_ = _not_white(fit, found)
    result = Adequacy(
        tests,
        unproven=tuple(one.name for one in open_ if not within_statement(fit, one)),
        stated=tuple(one.name for one in open_ if within_statement(fit, one)),
        unusable=tuple(one.name for one in fit.problem.noise.channels if one.unusable),
        sensors=sensors,
    )
    if not result.rejected or floors:
        return result
    return replace(result, below_noise=error_below(fit, BELOW_NOISE))


def _inputs_test(found: Sequence[Correlations]) -> Test:
    """Whether the errors of some channels follow the past of an input: the largest of all lags."""
    p_values = [one.follows for one in found]
    least = min([1.0, *(len(p_values) * p for p in p_values)])
    return Test(-math.log10(max(least, 1e-300)), least)


def _not_white(fit: FitResult, found: Mapping[str, Correlations]) -> list[ChannelNoise]:
    """The channels of which neither the noise is known nor the errors are white at the floor."""
    return [
        channel
        for channel in fit.problem.noise.channels
        if channel.name in fit.errors
        and (channel.own_scale or channel.standing == "guess")
        and not (channel.own_scale and white_at_floor(fit, channel, found.get(channel.name)))
        and not _within_noise_of_inputs(fit, channel)
    ]


def _within_noise_of_inputs(fit: FitResult, channel: ChannelNoise) -> bool:
    """Whether the errors of a channel are no larger than its floor and what measured inputs' noise adds.

    An input is smoothed, so that the part of its noise that remains is slow, and moves the outputs.
    """
    problem = fit.problem
    if problem.extra is None or not channel.floor:
        return False
    index = [one.name for one in problem.noise.channels].index(channel.name)
    added = float(np.sqrt(np.mean([problem.extra[k][index] ** 2 for k in fit.fitted])))
    return added > 0.0 and _no_larger(fit, channel, math.hypot(channel.floor, added))


def within_statement(fit: FitResult, channel: ChannelNoise) -> bool:
    """Whether a channel's errors are no larger, and no faster, than the noise that the rig file states."""
    return channel.allowed > 0.0 and beyond_statement(fit, channel) == ""


def beyond_statement(fit: FitResult, channel: ChannelNoise) -> Literal["", "unexplained", "larger", "faster"]:
    """Why a channel's errors are not the noise that the rig file states; "" if they may be."""
    if _moves(fit, channel) and not fit.errors[channel.name].r2 > LEAST_EXPLAINED:
        return "unexplained"
    if not _no_larger(fit, channel, channel.allowed):
        return "larger"
    slow = channel.together * fit.problem.noise.spacing
    return "faster" if slow < _FAST * channel.over else ""


def _no_larger(fit: FitResult, channel: ChannelNoise, level: float) -> bool:
    """Whether the errors of a channel are no larger than a noise with the standard deviation `level`, SI.

    Their mean square over n/τ independent readings scatters by ``√(2τ/n)`` of itself.
    """
    error = fit.errors[channel.name]
    scatter = math.sqrt(2.0 * channel.together / max(error.count, 1))
    return (error.rmse / level) ** 2 <= 1.0 + QUANTILE * scatter


def white_at_floor(fit: FitResult, channel: ChannelNoise, found: Correlations | None) -> bool:
    """Whether the errors of a channel are white, and no larger than the white part of its noise.

    Two conditions, each at 1 %: the portmanteau test, and the ratio of variances, whose floor is known to
    `_FLOOR_KNOWN` at best. Without a plateau the floor is an upper bound, and the errors' own differences are
    taken instead. A model that does not follow a moving channel never qualifies.
    """
    error = fit.errors[channel.name]
    if found is None or found.white_p < ALPHA:
        return False
    if not error.r2 > LEAST_EXPLAINED and _moves(fit, channel):
        return False
    floor = channel.floor
    if math.isfinite(found.white_rms):  # heavy tails count in a mean square, and not in the median
        own = found.white_rms
        floor = max(floor, min(own, _TAILS * floor)) if channel.plateau else own
    if not floor > 0.0:
        return False
    degrees = found.white_degrees or 1
    spread = math.sqrt(2.0 / error.count + 2.0 / degrees + (2.0 * _FLOOR_KNOWN) ** 2)
    return ((error.rmse / floor) ** 2 - 1.0) / spread < QUANTILE


def _moves(fit: FitResult, channel: ChannelNoise) -> bool:
    """Whether a channel varies by more than noise at its floor."""
    error = fit.errors[channel.name]
    if not math.isfinite(error.r2):
        return False
    spread = error.rmse / math.sqrt(max(1.0 - error.r2, 1e-12))
    return spread > _MOVING * channel.floor


def error_below(fit: FitResult, share: float) -> bool:
    """Whether every channel's RMS error is at most this share of its noise.

    For a right model it equals the noise, as far as that is known: below `BELOW_NOISE` the noise is not what
    was assumed.
    """
    return all(error.nrmse <= share for error in fit.errors.values())


def plane_test(projected: Projected) -> Test:
    """Regression of the whitened residuals, summed over each phase and channel, on {1, T, p, T·p, …}.

    With M the regressors in whitened rows, ``χ² = r̃ᵀM̃(M̃ᵀM̃)⁺M̃ᵀr̃``, M̃ = (I − P_J)M.
    """
    lin = projected.linearisation
    # In whitened rows: the sum of the residuals of each phase and channel (E), times each function of the
    # operating point. A pattern within a phase cancels in the sum, and is left to the other tests.
    columns = np.vstack([_outer(lin.records[k].regions, lin.regions.plane(k)) for k in projected.records])
    independent = projected.project(columns)
    lengths = np.linalg.norm(independent, axis=0)
    full_lengths = np.linalg.norm(columns, axis=0)
    # What the fitted unknowns absorb but for a thousandth cannot be tested; the rank of the rest is the
    # number of degrees of freedom.
    good = lengths > 1e-3 * np.where(full_lengths > 0.0, full_lengths, 1.0)
    good &= full_lengths > 0.0
    if not good.any():
        return Test(0.0, 1.0, 0)
    span, values, _ = np.linalg.svd(independent[:, good] / lengths[good], full_matrices=False)
    span = span[:, values > 1e-3 * values[0]]
    statistic = float(np.square(span.T @ projected.residual).sum())
    dof, known = span.shape[1], projected.noise_degrees
    return Test(statistic, chi2_tail(statistic, dof, known), dof, math.sqrt(2.0 * dof), known)


def chi2_test(projected: Projected) -> Test:
    """``χ² = r̃ᵀr̃``, its variance increased by the uncertainty of the noise itself."""
    lin = projected.linearisation
    statistic = float(projected.residual @ projected.residual)
    dof = projected.dof
    if dof <= 0:
        return Test(statistic, 1.0, 0)
    if projected.noise_degrees:
        known = projected.noise_degrees
        return Test(statistic, chi2_tail(statistic, dof, known), dof, known=known)
    # σ² of a channel is itself an estimate: with ν degrees of freedom, n·F(n, ν) has about 2n²/ν more
    # variance than χ²(n). With several channels of different ν there is no such F, and the sum is treated as
    # normal.
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


def _quantile(dof: int, known: int) -> float:
    """The quantile of F(dof, known) that chance exceeds with probability `ALPHA`."""
    from scipy.special import fdtri

    return float(fdtri(dof, known, 1.0 - ALPHA))


def _outer(regions: Floats, plane: Floats) -> Floats:
    """(rows, columns·basis) products of each region's column with each function of the basis."""
    return np.asarray((regions[:, :, None] * plane).reshape(regions.shape[0], -1))


#: largest lag in the sum, as a share of the longest record
_LAGS = 0.25


def variance_factor(fit: FitResult) -> float:
    """Long-run variance of the whitened residuals, at least 1: 1 if a model leaves only noise.

    ``φ = c_0 + 2·Σ_(k ≤ K) (1 − k/(K + 1))·c_k``, c_k the autocovariance at lag k of the residuals of each
    channel of each record, over all fitted ones; K is a quarter of the longest. The residuals of a model that
    is wrong in any case (another law, a slow drift) vary more than the noise, and slowly: readings are not
    independent, and a difference of χ² between two such models counts as 1/φ of itself.

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
    """The whitened residuals of each channel of each fitted record, in order of time."""
    series = []
    for index in fit.fitted:
        white = whitened_residual(fit.problem, fit.outputs[index], index)
        channel = fit.problem.whiteners[index].rows[:, 1]
        series += [white[channel == one] for one in np.unique(channel)]
    return [one for one in series if one.size]


def _autocovariance(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sums of the products of values k apart, for k = 0, 1, …"""
    padded = np.fft.rfft(values, 2 * values.size)
    return np.asarray(np.fft.irfft(np.abs(padded) ** 2, 2 * values.size)[: values.size])


#: errors that stay alike for less than this share of a stated time are another noise than the stated one
_FAST = 0.1
#: a floor is known to this share of it at best
_FLOOR_KNOWN = 0.04
#: heavy tails make a root mean square larger than a median of absolute values says, by at most this factor
_TAILS = 1.4


#: a channel moves if it varies by more than this many times its floor
_MOVING = 3.0
