"""Confidence intervals that do not rely on the noise model: a wild cluster bootstrap.

The standard errors of a fit rely on the noise that was learned, on residuals without a pattern, and on a
model that is nearly linear. Here the model is fitted repeatedly to measurements that could equally have been
observed: its outputs, and its residuals with a random sign for each cluster of records,

    y*_i = f_i(θ̂) + c · w_g(i) · (y_i − f_i(θ̂)),   c² = G/(G − 1) · (N − 1)/(N − p),

for G clusters with N readings in all, and p parameters. A cluster is a condition, whose records share what
the model lacks there, or a single record if there are few conditions. Residuals keep their time series within
a record: nothing is assumed about their correlation, their distribution, or equal size everywhere. The prior
of an unknown of a record is treated like a reading and is drawn with it. A common unknown, the zero of a
calibration or a guess, has one prior only, of which a sign would show nothing: its mean is drawn as its
standard deviation says.

Source: A. C. Cameron, J. B. Gelbach, D. L. Miller, Rev. Econ. Stat. 90 (2008) 414; weights of few clusters:
M. D. Webb, Queen's Economics Department Working Paper 1315 (2013).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from rigctl.engine.least_squares import Unknown
from rigctl.engine.one_thread import one_thread
from rigctl.errors import ExitCode, RigctlError
from rigctl.model.fit.fit import FitResult, fit, without_derived
from rigctl.model.value_table import stated_values
from rigctl.tasks import Countdown, Workers, map_tasks, seed_of
from rigctl.units import parse_unit

Floats = NDArray[np.float64]

#: coverage probability of an interval
LEVEL: Final = 0.95
#: least number of conditions that serve as clusters; of fewer there are too few combinations of signs
_CONDITIONS: Final = 6
#: with fewer clusters than this, weights are drawn from six values, or few results would be possible
_FEW: Final = 12
_WEBB: Final = np.sqrt([0.5, 1.0, 1.5])
#: least number of successful repetitions for an interval
_ENOUGH: Final = 20
#: each repetition is fitted until the next step would lower its cost by less than this share
_COST: Final = 1e-4


@dataclass(frozen=True)
class Interval:
    """The results for one parameter in the repetitions, in the unit in which it is shown.

    Attributes
    ----------
    value: of the fit; `std` the standard deviation over the repetitions, `low` and `high` their quantiles.
    fit_std: the standard error of the fit itself; NaN if it has none.
    """

    name: str
    unit: str
    value: float
    std: float
    low: float
    high: float
    fit_std: float

    def document(self) -> dict[str, Any]:
        """Its machine-readable form."""
        facts = {"value": self.value, "unit": self.unit, "std": self.std, "low": self.low, "high": self.high}
        return facts | {"fit_std": self.fit_std if math.isfinite(self.fit_std) else None}


@dataclass(frozen=True)
class Bootstrap:
    """The intervals of every fitted parameter.

    Attributes
    ----------
    repetitions: number of successful repetitions; `failed` the number of others.
    by: unit of resampling: ``condition`` or ``record``; `clusters` of them.
    """

    repetitions: int
    failed: int
    by: str
    clusters: int
    parameters: tuple[Interval, ...]

    def document(self) -> dict[str, Any]:
        """The machine-readable answer."""
        return {
            "repetitions": self.repetitions,
            "failed": self.failed,
            "by": self.by,
            "clusters": self.clusters,
            "level": LEVEL,
            "parameters": {one.name: one.document() for one in self.parameters},
        }


def bootstrap(
    fitted: FitResult,
    repetitions: int,
    *,
    seed: int = 0,
    workers: Workers | None = None,
    on_progress: Callable[[str], None] | None = None,
) -> Bootstrap:
    """Fit a model repeatedly to measurements that could equally have been observed.

    Parameters
    ----------
    fitted: of the model to be judged; held-out records remain held out.
    repetitions: 200 determine an interval to a tenth of its length.
    seed: of the signs; they do not depend on where a repetition is computed.

    Raises
    ------
    RigctlError
        as `require_resampling`, or hardly any repetition can be fitted.
    """
    require_resampling(fitted)
    groups = [fitted.problem.records[index].group for index in fitted.fitted]
    by = "condition" if len(set(groups)) >= _CONDITIONS else "record"
    clusters = groups if by == "condition" else list(range(len(groups)))
    count = len(set(clusters))
    work = partial(_repeated, without_derived(fitted), tuple(clusters), seed)
    done = None if on_progress is None else Countdown("Resampling the data", on_progress)
    estimates: dict[int, Floats | None] = dict(map_tasks(work, range(repetitions), workers, on_progress=done))
    ended = [values for number in sorted(estimates) if (values := estimates[number]) is not None]
    if len(ended) < min(_ENOUGH, repetitions):
        raise RigctlError(
            f"only {len(ended)} of {repetitions} repetitions could be fitted",
            hint="The fit itself is barely determined: use fewer free parameters, or more records",
            exit_code=ExitCode.FAILED,
        )
    return Bootstrap(len(ended), repetitions - len(ended), by, count, _intervals(fitted, np.array(ended)))


def require_resampling(fitted: FitResult) -> None:
    """Refuse a fit that the bootstrap cannot repeat, before the work whose result it would be given for.

    Raises
    ------
    RigctlError
        no parameter was fitted, or only one record.
    """
    if fitted.solution is None or not fitted.problem.shared:
        raise RigctlError(
            "no parameter was fitted, so there is nothing to bootstrap",
            expected="a model with free parameters",
        )
    if len(fitted.fitted) < 2:
        raise RigctlError(
            "the bootstrap needs at least two fitted records, better ten", value=str(len(fitted.fitted))
        )


@one_thread()
def _repeated(fitted: FitResult, clusters: Sequence[int], seed: int, number: int) -> Floats | None:
    """(shared) the parameters from one repetition; None if it cannot be fitted."""
    chance = np.random.default_rng(seed_of(seed, "bootstrap", number))
    # y* = f + c·w·(y − f) for the readings of each cluster, the same w for the priors of its records'
    # unknowns.
    weights = _weights(clusters, chance)
    problem, factor = fitted.problem, _factor(fitted, len(set(clusters)))
    of_record = dict(zip(fitted.fitted, (weights[cluster] for cluster in clusters), strict=True))
    records, local = list(problem.records), list(problem.local)
    for index, weight in of_record.items():
        record, says = records[index], fitted.outputs[index]
        records[index] = replace(record, values=says + weight * factor * (record.values - says))
        local[index] = tuple(
            replace(one, unknown=_drawn(one.unknown, float(value), weight))
            for one, value in zip(local[index], fitted.local[index], strict=True)
        )
    # Shared unknowns start at the fit; the mean of a shared prior is drawn, since it has a single "residual".
    shared = [
        _as_stated(unknown, float(value), chance)
        for unknown, value in zip(problem.shared, fitted.values, strict=True)
    ]
    drawn = replace(
        problem,
        measurements=replace(problem.measurements, records=tuple(records)),
        local=tuple(local),
        shared=tuple(shared),
    )
    try:
        refitted = fit(drawn, fitted.held_out, local=fitted.local, cost=_COST)
    except RigctlError:  # the model cannot be simulated there
        return None
    estimates = {
        one.name: float(value) for one, value in zip(refitted.problem.shared, refitted.values, strict=True)
    }
    return np.array([estimates.get(one.name, one.start) for one in shared])


def _drawn(unknown: Unknown, value: float, weight: float) -> Unknown:
    """The unknown with its prior mean moved to the other side of `value` if the weight is negative."""
    prior = unknown.prior
    if prior is None:
        return unknown
    return replace(unknown, prior=replace(prior, mean=value + weight * (prior.mean - value)))


def _as_stated(unknown: Unknown, value: float, chance: np.random.Generator) -> Unknown:
    """The unknown that starts at `value`, with a prior mean as far from it as its standard deviation says."""
    prior = unknown.prior
    if prior is not None:
        prior = replace(prior, mean=value + prior.std * float(chance.standard_normal()))
    return replace(unknown, prior=prior, start=min(max(value, unknown.lower), unknown.upper))


def _weights(clusters: Sequence[int], chance: np.random.Generator) -> Mapping[int, float]:
    """A weight for each cluster, with mean 0 and variance 1; with few clusters, of six values."""
    names = sorted(set(clusters))
    signs = chance.choice([-1.0, 1.0], len(names))
    if len(names) < _FEW:
        signs *= chance.choice(_WEBB, len(names))
    return dict(zip(names, signs.tolist(), strict=True))


def _factor(fitted: FitResult, clusters: int) -> float:
    """The factor c, which corrects residuals for the part of the noise that the fit has absorbed."""
    solution = fitted.solution
    assert solution is not None  # noqa: S101 - asked before
    readings, free = solution.residual_count, solution.parameter_count
    share = max(readings - 1, 1) / max(readings - free, 1)
    return math.sqrt(clusters / (clusters - 1) * share)


def _intervals(fitted: FitResult, estimates: Floats) -> tuple[Interval, ...]:
    low, high = np.quantile(estimates, [0.5 - LEVEL / 2, 0.5 + LEVEL / 2], axis=0)
    indices = {unknown.name: index for index, unknown in enumerate(fitted.problem.shared)}
    intervals = []
    for stated in stated_values(fitted.at_end):
        if stated.name not in indices:
            continue
        index, unit = indices[stated.name], parse_unit(stated.unit)
        shown = partial(unit.from_si, difference=stated.difference)
        intervals.append(
            Interval(
                stated.name,
                stated.unit,
                shown(float(fitted.values[index])),
                float(estimates[:, index].std(ddof=1)) / unit.factor,
                shown(float(low[index])),
                shown(float(high[index])),
                fitted.std.get(stated.name, math.nan) / unit.factor,
            )
        )
    return tuple(intervals)
