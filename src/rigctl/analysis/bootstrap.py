"""Intervals of fitted parameters that do not believe the noise model: a wild bootstrap by cluster.

What a fit says of its own accuracy rests on the noise that was learned, on residuals without a pattern, and
on a model that is straight nearby. Here the model is fitted again to measurements that could have come as
well: what it says, and its residuals with the sign of each cluster of records drawn,

    y*_i = f_i(θ̂) + c · w_g(i) · (y_i − f_i(θ̂)),   c² = G/(G − 1) · (N − 1)/(N − p),

G clusters of N readings, p parameters. A cluster is a condition, whose records share what the model lacks
there, or a record where there are few conditions. Its residuals keep their course in time: nothing is
assumed of their correlation, of their distribution, or that they are as large everywhere. What is known of
an unknown before (a prior) is a reading like any other, and is drawn with its record.

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

from rigctl.analysis.sending import lean
from rigctl.engine.least_squares import Prior, Unknown
from rigctl.engine.one_thread import one_thread
from rigctl.errors import ExitCode, RigctlError
from rigctl.model.fit.fit import FitResult, fit
from rigctl.model.stated import stated_values
from rigctl.tasks import Workers, map_tasks, seed_of
from rigctl.units import parse_unit

Floats = NDArray[np.float64]

#: the share of repetitions that an interval holds
LEVEL: Final = 0.95
#: from so many conditions on they are the clusters; of fewer there are too few ways to draw their signs
_CONDITIONS: Final = 6
#: fewer clusters than this are drawn from six weights, or few results would be possible
_FEW: Final = 12
_WEBB: Final = np.sqrt([0.5, 1.0, 1.5])
#: an interval from fewer repetitions that ended well is none
_ENOUGH: Final = 20
#: repetitions are fitted until the next step would lower the cost by less than this share of it
_COST: Final = 1e-4


@dataclass(frozen=True)
class Interval:
    """What one parameter came to in the repetitions, in the unit it is shown in.

    Attributes
    ----------
    value: of the fit; `std` the standard deviation of the repetitions, `low` and `high` their quantiles.
    fit_std: what the fit says of itself; NaN where it does not.
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
    """The intervals of every parameter that was fitted.

    Attributes
    ----------
    repetitions: how many ended well; `failed` how many others there were.
    by: what was drawn: ``condition`` or ``record``; `clusters` of them.
    """

    repetitions: int
    failed: int
    by: str
    clusters: int
    parameters: tuple[Interval, ...]

    @property
    def statement(self) -> str:
        """How it was made, in words."""
        failed = f"; {self.failed} could not be fitted" if self.failed else ""
        return (
            f"{100 * LEVEL:.0f} % of {self.repetitions} repetitions, in each of which the residuals of "
            f"{self.clusters} {self.by}s had their signs drawn{failed}"
        )

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
    """Fit a model again and again to what could have been measured as well.

    Parameters
    ----------
    fitted: of the model to judge; held-out records stay so.
    repetitions: 200 give an interval to a tenth of its length.
    seed: of the signs; they do not depend on where a repetition is fitted.

    Raises
    ------
    RigctlError
        nothing was fitted, there are fewer than two records, or hardly a repetition can be fitted.
    """
    if fitted.solution is None or not fitted.problem.shared:
        raise RigctlError("nothing was fitted: there is nothing to give an interval of")
    groups = [fitted.problem.records[index].group for index in fitted.fitted]
    by = "condition" if len(set(groups)) >= _CONDITIONS else "record"
    clusters = groups if by == "condition" else list(range(len(groups)))
    count = len(set(clusters))
    if count < 2:
        raise RigctlError("one record cannot be drawn from", expected="two records at least, better ten")
    work = partial(_repeated, lean(fitted), tuple(clusters), seed)

    def told(done: int, total: int) -> None:
        if on_progress is not None:
            on_progress(f"Repetition {done} of {total}")

    found: dict[int, Floats | None] = dict(map_tasks(work, range(repetitions), workers, on_progress=told))
    ended = [values for number in sorted(found) if (values := found[number]) is not None]
    if len(ended) < min(_ENOUGH, repetitions):
        raise RigctlError(
            f"only {len(ended)} of {repetitions} repetitions could be fitted",
            hint="The fit itself hangs by a thread: fewer free parameters, or more records",
            exit_code=ExitCode.FAILED,
        )
    return Bootstrap(len(ended), repetitions - len(ended), by, count, _intervals(fitted, np.array(ended)))


@one_thread()
def _repeated(fitted: FitResult, clusters: Sequence[int], seed: int, number: int) -> Floats | None:
    """(shared) what one repetition finds; None where it cannot be fitted."""
    chance = np.random.default_rng(seed_of(seed, "bootstrap", number))
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
    own = _weights(range(len(problem.shared)), chance)
    shared = [
        _drawn(unknown, float(value), own[place], start=float(value))
        for place, (unknown, value) in enumerate(zip(problem.shared, fitted.values, strict=True))
    ]
    drawn = replace(
        problem,
        measurements=replace(problem.measurements, records=tuple(records)),
        local=tuple(local),
        shared=tuple(shared),
    )
    try:
        again = fit(drawn, fitted.held_out, local=fitted.local, cost=_COST)
    except RigctlError:  # the model has no value there
        return None
    found = {one.name: float(value) for one, value in zip(again.problem.shared, again.values, strict=True)}
    return np.array([found.get(one.name, one.start) for one in shared])


def _drawn(unknown: Unknown, value: float, weight: float, start: float | None = None) -> Unknown:
    """The unknown with what is known of it before on the other side of `value`, as its sign says."""
    prior = unknown.prior
    if prior is not None:
        prior = Prior(value + weight * (prior.mean - value), prior.std)
    begin = unknown.start if start is None else min(max(start, unknown.lower), unknown.upper)
    return replace(unknown, prior=prior, start=begin)


def _weights(clusters: Sequence[int] | range, chance: np.random.Generator) -> Mapping[int, float]:
    """Of each cluster the sign, with mean 0 and variance 1; of few ones, of six sizes."""
    names = sorted(set(clusters))
    signs = chance.choice([-1.0, 1.0], len(names))
    if len(names) < _FEW:
        signs *= chance.choice(_WEBB, len(names))
    return dict(zip(names, signs.tolist(), strict=True))


def _factor(fitted: FitResult, clusters: int) -> float:
    """By how much residuals are smaller than the noise they come from: the fit has taken its part."""
    solution = fitted.solution
    assert solution is not None  # noqa: S101 - asked before
    readings, free = solution.residual_count, solution.parameter_count
    share = max(readings - 1, 1) / max(readings - free, 1)
    return math.sqrt(clusters / (clusters - 1) * share)


def _intervals(fitted: FitResult, found: Floats) -> tuple[Interval, ...]:
    low, high = np.quantile(found, [0.5 - LEVEL / 2, 0.5 + LEVEL / 2], axis=0)
    places = {unknown.name: place for place, unknown in enumerate(fitted.problem.shared)}
    made = []
    for stated in stated_values(fitted.model):
        if stated.name not in places:
            continue
        place, unit = places[stated.name], parse_unit(stated.unit)
        shown = partial(unit.from_si, difference=stated.difference)
        made.append(
            Interval(
                stated.name,
                stated.unit,
                shown(float(fitted.values[place])),
                float(found[:, place].std(ddof=1)) / unit.factor,
                shown(float(low[place])),
                shown(float(high[place])),
                fitted.std.get(stated.name, math.nan) / unit.factor,
            )
        )
    return tuple(made)
