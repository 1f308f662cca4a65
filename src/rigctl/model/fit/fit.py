"""Fit a model's free parameters to measurements, and judge it on records that the fit did not see.

In: a `Problem` and the records to be held out. Out: a `FitResult`, from which values, standard deviations
and errors are asked as they are needed. A fit without known starting values goes a long way: from distant
starting values to a coarse end, once more from there with what is far from its priors reset, and only then
to convergence (`_from_afar`), since a single descent ends in the nearest valley. Results are kept by content
(`rigctl.engine.result_cache`): a diagnosis repeats fits of the comparison before it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import cached_property, partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rigctl.engine.least_squares import (
    Iteration,
    LeastSquaresResult,
    Options,
    Refused,
    Unknown,
    least_squares,
    multi_start,
    started,
)
from rigctl.engine.result_cache import cached
from rigctl.errors import RigctlError
from rigctl.model.fit.approach import approach, reset_to_priors
from rigctl.model.fit.errors import ChannelError, channel_errors
from rigctl.model.fit.input_noise import with_input_noise
from rigctl.model.fit.problem import Problem
from rigctl.model.fit.stated_errors import StatedErrors, stated_errors
from rigctl.model.fit.switch_scan import with_best_switches
from rigctl.model.model import Model
from rigctl.notebook import as_html, one_line
from rigctl.wording import number_of

if TYPE_CHECKING:
    import pandas as pd

Floats = NDArray[np.float64]

#: a fit ends when the next step would lower the cost by less than this share of it
_COST = 1e-5
#: the same for a fit that only decides which of two minima is deeper
_COARSE = 3e-4
#: the same if χ² is too large by this many of its standard deviations: such a model is inadequate wherever
#: along its valley the fit ends, and the tests project out what its parameters could still explain
_ROUGH, _MISFIT = 1e-4, 20.0


@dataclass(frozen=True)
class FitResult:
    """A model fitted to some records, and its predictions of these and the others.

    Attributes
    ----------
    problem: all records, fitted and held out.
    fitted: the indices of the fitted records; `held_out` those of the others.
    solution: of the fit; None if nothing was free.
    values: (shared) of `problem.shared`.
    local: the record-level unknowns of all records, in order. Those of held-out records are fitted to them:
        their temperatures and valve settings are not for the model to predict.
    outputs: (n, outputs) of each record, predicted by the model.
    silent: parameters that were free but affect no reading; they kept their values.
    """

    problem: Problem = field(repr=False)
    fitted: tuple[int, ...]
    solution: LeastSquaresResult | None
    values: Floats
    local: tuple[Floats, ...] = field(repr=False)
    outputs: tuple[Floats, ...] = field(repr=False)
    silent: tuple[str, ...] = ()

    @property
    def held_out(self) -> tuple[int, ...]:
        """The indices of the records that the fit did not see."""
        return tuple(index for index in range(len(self.problem.records)) if index not in self.fitted)

    @property
    def unknowns(self) -> int:
        """How many unknowns were fitted to the records together, those of the records included."""
        if self.solution is None:
            return 0
        return len(self.solution.unknowns) + sum(self.local[k].size for k in self.fitted)

    @cached_property
    def at_bound(self) -> frozenset[str]:
        """The shared unknowns that the fit left at a bound; none for a model that was not fitted."""
        return frozenset() if self.solution is None else frozenset(self.solution.at_bound)

    def normalised_error(self, index: int) -> Floats:
        """(n, channels) (f − y)/σ of the record at `index`; NaN where no reading counts."""
        problem = self.problem
        error = (self.outputs[index] - problem.records[index].values) / problem.sigma[index]
        return np.where(problem.ok[index], error, np.nan)

    @cached_property
    def likely_outputs(self) -> tuple[Floats, ...]:
        """The outputs with scatter that is no unknown, see `Problem.scatter`, at its most likely values."""
        problem = self.problem
        if problem.scatter is None:
            return self.outputs
        return tuple(
            output - whitener.scatter_in(output - record.values, columns)
            for output, whitener, columns, record in zip(
                self.outputs, problem.whiteners, problem.scatter, problem.records, strict=True
            )
        )

    @cached_property
    def model(self) -> Model:
        """The model with the fitted values, their standard deviations and the runs from which they come."""
        return self._with_values(self.reported_std)

    @cached_property
    def at_end(self) -> Model:
        """`model` for whatever goes on from the end of this fit, with the uncertainty that its search uses,
        which costs no evaluation."""
        return self._with_values(self.std)

    def _with_values(self, deviations: Mapping[str, float]) -> Model:
        model = self.problem.model
        known = {*model.fitted, *model.assumed} if self.solution is not None else set()
        changes = {
            unknown.name: float(value)
            for unknown, value in zip(self.problem.shared, self.values, strict=True)
            if unknown.name in known
        }
        lost = self.undetermined
        std = {
            name: value
            for name, value in deviations.items()
            if name in changes and name not in lost and 0.0 < value < math.inf
        }
        runs = ", ".join(self.problem.measurements.runs)
        source = f"fitted {datetime.now(UTC):%Y-%m-%d} to {runs}"
        return self.problem.model.with_values(changes, std=std, source=source, undetermined=lost)

    @cached_property
    def undetermined(self) -> frozenset[str]:
        """The shared unknowns of which the data determine only combinations."""
        weak = () if self.solution is None else self.solution.weak
        return frozenset(name for one in weak for name, _ in one.parts)

    @cached_property
    def std(self) -> dict[str, float]:
        """The standard deviation of each shared unknown, SI, where sensors of no stated kind of error are
        exact: what a search decides by."""
        if self.solution is None:
            return {}
        return {u.name: float(s) for u, s in zip(self.solution.unknowns, self.solution.std, strict=True)}

    @cached_property
    def stated_errors(self) -> StatedErrors:
        """The errors of sensors that it took for exact, and what they do to the shared unknowns."""
        if self.solution is None:
            return StatedErrors((), np.zeros((len(self.problem.shared), 0)))
        local = [self.local[k] for k in self.fitted]
        return stated_errors(self.problem.only(self.fitted), self.values, local)

    @cached_property
    def reported_covariance(self) -> Floats:
        """(p, p) of the shared unknowns, with all that is stated of sensors."""
        known = 0.0 if self.solution is None else self.solution.covariance
        return np.asarray(known + self.stated_errors.covariance)

    @cached_property
    def reported_std(self) -> dict[str, float]:
        """The standard deviation of each shared unknown, SI, with all that is stated of sensors."""
        if self.solution is None:
            return {}
        stds = np.sqrt(np.diag(self.reported_covariance))
        return {one.name: float(std) for one, std in zip(self.solution.unknowns, stds, strict=True)}

    @cached_property
    def expected_outputs(self) -> tuple[Floats, ...]:
        """(n, outputs) of each record with its record-level unknowns at their expected values.

        In `outputs` they are fitted, and may have compensated for errors of the model.
        """
        expected = [
            np.array([unknown.start for unknown in record_local])
            for record_local in self.problem.local_unknowns()
        ]
        simulated = self.problem.simulate(self.values, expected)
        if not simulated.ok:
            return self.outputs
        return tuple(np.take(array, self.problem.channels, axis=1) for array in simulated.outputs)

    @cached_property
    def errors(self) -> dict[str, ChannelError]:
        """By channel, on the fitted records."""
        return channel_errors(self.problem, self.outputs, self.fitted)

    @cached_property
    def heldout_errors(self) -> dict[str, ChannelError]:
        """By channel, on the held-out records; empty if there are none."""
        return channel_errors(self.problem, self.outputs, self.held_out) if self.held_out else {}

    @cached_property
    def chi2_reduced(self) -> float:
        """Whitened squares, including the priors', per degree of freedom, on the fitted records."""
        if self.solution is not None:
            return self.solution.variance_factor
        problem = self.problem.only(self.fitted)
        blocks = problem.evaluate(self.values, [self.local[k] for k in self.fitted], False)
        if isinstance(blocks, Refused):
            raise RigctlError(blocks.reason)
        squares = [float(block.residual @ block.residual) for block in blocks]
        return sum(squares) / max(1, sum(block.residual.size for block in blocks))

    def __repr__(self) -> str:
        """One-line representation."""
        return one_line(self, self.summary())

    def summary(self) -> str:
        """One line: the model, its free parameters, the records, and the misfit beside the noise."""
        free = 0 if self.solution is None else len(self.solution.unknowns)
        return (
            f"{self.problem.model.name}: {number_of(free, 'parameter')} fitted to "
            f"{number_of(len(self.fitted), 'record')}, "
            f"chi² reduced {self.chi2_reduced:.3g}"
        )

    def frame(self) -> pd.DataFrame:
        """The free parameters of the fitted model, in their display units."""
        frame = self.model.frame()
        return frame[frame["free"]].drop(columns="free").reset_index(drop=True)

    def _repr_html_(self) -> str:
        """The summary and the parameters, as a notebook shows them."""
        return as_html(self.summary(), self.frame())


def without_derived(fitted: FitResult) -> FitResult:
    """The fit without derived results, to be sent to another process, which recomputes them if needed."""
    return replace(fitted, problem=fitted.problem.fresh())


# The fit itself, from here on: `fit` repeats it in the noise that it shows, `_fit` takes it from the cache if
# an earlier command made it, `_fitted` decides what is free, and `_from_afar` where it starts.
def fit(
    problem: Problem,
    hold_out: Sequence[int] = (),
    *,
    refit: bool = True,
    starts: int = 1,
    seed: int = 0,
    local: Sequence[Floats] | None = None,
    cost: float = _COST,
    largest_step: float = Options.largest_step,
    rival: float = math.inf,
    progress: Callable[[Iteration], None] | None = None,
) -> FitResult:
    """Fit the shared unknowns on all records except `hold_out`, and the record-level ones on each record.

    Parameters
    ----------
    refit: False keeps the shared unknowns at their starts.
    starts: number of starting points; more than one for costs with several minima.
    local: starting values of the record-level unknowns, if better ones than the priors' are known.
    cost, largest_step, rival: as in `rigctl.engine.least_squares.Options`.

    Raises
    ------
    RigctlError
        no record is left to fit on, there are fewer values than parameters, or the model cannot be simulated
        at the start.
    """
    # noise may be a share of the value, and scatter of switches and noise of inputs act as the model
    # predicts: they are known only after a fit, whose values are where the second one starts
    options = Options(cost=cost, largest_step=largest_step, rival=rival)
    plan = _Plan(refit, starts, seed, options, progress)
    result = _fit(problem, hold_out, plan, local)
    better = _with_noise_of(problem, result)
    return result if better is None else _fit(better, hold_out, plan, result.local)


@dataclass(frozen=True)
class _Plan:
    """The settings of a fit."""

    refit: bool
    starts: int
    seed: int
    options: Options
    progress: Callable[[Iteration], None] | None


@dataclass(frozen=True)
class _Fitted:
    """The part of a fit that is kept between commands; see `FitResult`."""

    silent: tuple[str, ...]
    solution: LeastSquaresResult | None
    values: Floats
    local: tuple[Floats, ...]
    outputs: tuple[Floats, ...]


def _fit(problem: Problem, hold_out: Sequence[int], plan: _Plan, local: Sequence[Floats] | None) -> FitResult:
    # the key of the cache is the content of the problem, without names and without what it remembers: a copy
    # of a run, or a model under another name, finds the same result
    fitted = tuple(index for index in range(len(problem.records)) if index not in set(hold_out))
    if not fitted:
        raise RigctlError("every record is held out: nothing is left to fit on")
    result = cached(
        "fit",
        (problem.content, fitted, plan.refit, plan.starts, plan.seed, plan.options, local),
        _Fitted,
        lambda: _fitted(problem, fitted, plan, local),
    )
    if result.silent:
        problem = problem.with_shared([one for one in problem.shared if one.name not in result.silent])
    return FitResult(
        problem.fresh(), fitted, result.solution, result.values, result.local, result.outputs, result.silent
    )


def _fitted(
    problem: Problem, fitted: tuple[int, ...], plan: _Plan, local: Sequence[Floats] | None
) -> _Fitted:
    # what affects no reading cannot be fitted: it keeps its value, and is named in the result
    count = len(problem.records)
    silent: tuple[str, ...] = ()
    inner = problem.only(fitted)
    initial = None if local is None else [local[k] for k in fitted]
    if plan.refit and problem.shared:
        silent = _silent(inner, initial)
    if silent:
        problem = problem.with_shared([one for one in problem.shared if one.name not in silent])
        inner = problem.only(fitted)
    start = np.array([unknown.start for unknown in problem.shared])
    if problem.compiled.cascade is not None:  # derivatives through a program are differences
        accuracy = partial(problem.compiled.accuracy, [unknown.name for unknown in problem.shared])
        plan = replace(plan, options=replace(plan.options, accuracy=accuracy))
    if plan.refit and problem.shared:
        _check_enough(inner)
        inside = _started(inner, initial)
        if plan.starts > 1:
            solution = multi_start(
                inner.evaluate,
                inner.shared,
                inside,
                count=plan.starts,
                seed=plan.seed,
                options=plan.options,
                progress=plan.progress,
            ).best
        elif local is None:
            solution = _from_afar(inner, inside, plan)
        else:
            solution = least_squares(
                inner.evaluate, inner.shared, inside, options=plan.options, progress=plan.progress
            )
        # the cost jumps where a switch passes a sample: no gradient leads across
        solution = with_best_switches(inner, solution, plan.options)
        values, record_local = solution.values, dict(zip(fitted, solution.local, strict=True))
    else:
        solution, values, record_local = None, start, {}
    # records held out: the model's parameters are given, what belongs to the record is fitted to it
    rest = [index for index in range(count) if index not in record_local]
    record_local |= _local_unknowns(problem, values, rest, local)
    everything = tuple(record_local[index] for index in range(count))
    evaluated = (
        inner if len(fitted) == count else problem
    )  # the last evaluation of the fit is usually at its end
    return _Fitted(silent, solution, values, everything, evaluated.outputs_at(values, everything))


def _from_afar(problem: Problem, local: list[list[Unknown]], plan: _Plan) -> LeastSquaresResult:
    """The better of two coarse fits, continued to convergence: one from distant starting values, and one from
    its end, with the parameters that are far from their priors reset."""
    # 1. from distant values to where the misfit is small, and down to a coarse tolerance there
    starts, record_local = approach(problem.evaluate, problem.shared, local, plan.progress)
    coarse = replace(plan.options, cost=max(plan.options.cost, _COARSE))
    result = least_squares(problem.evaluate, starts, record_local, options=coarse, progress=plan.progress)
    # 2. once more from there, with what the long way has driven from its prior put back: if that ends lower,
    # the first end was a local minimum
    back = reset_to_priors(starts, result.values)
    if back is not None:
        with suppress(RigctlError):  # the model cannot be simulated there: the first fit is kept
            other = least_squares(
                problem.evaluate, back, record_local, options=coarse, progress=plan.progress
            )
            result = other if other.cost < result.cost else result
    # 3. the better one to convergence; less so if χ² is off by so much that nothing depends on its last
    # digits
    dof = max(1, result.residual_count - result.parameter_count)
    far = 2.0 * result.cost - dof > _MISFIT * math.sqrt(2.0 * dof)
    return least_squares(
        problem.evaluate,
        started(starts, result.values),
        [started(each, values) for each, values in zip(record_local, result.local, strict=True)],
        options=replace(plan.options, cost=max(plan.options.cost, _ROUGH)) if far else plan.options,
        progress=plan.progress,
    )


def _with_noise_of(problem: Problem, fitted: FitResult) -> Problem | None:
    """The problem with the noise given by a fit, starting there; None if nothing changes.

    Noise may be a share of the value, and unknown scatter acts as the model predicts.
    """
    at = {u.name: float(value) for u, value in zip(fitted.problem.shared, fitted.values, strict=True)}
    better = problem
    if problem.scatter is None and problem.extra is None:
        # parameters without any effect are not unknowns of the fit
        values = np.array([at.get(unknown.name, unknown.start) for unknown in problem.shared])
        better = with_input_noise(problem.scattered(values, fitted.local), values, fitted.local)
    if problem.signal is None:
        better = better.with_signal(fitted.outputs)
    if better is problem:
        return None
    return better.with_shared([replace(u, start=at.get(u.name, u.start)) for u in better.shared])


def _silent(problem: Problem, local: Sequence[Floats] | None) -> tuple[str, ...]:
    """The shared unknowns that affect no reading; these keep their values.

    Evaluated at the starting point of the fit, whose first evaluation it is.
    """
    record_local = _started(problem, local)
    squares = _shared_squares(problem, record_local, 0.0)
    if squares is not None and not squares.all():
        # record-level unknowns may be what makes it act: a storage that starts at rest shows no rate
        moved = _shared_squares(problem, record_local, 1.0)
        squares = None if moved is None else squares + moved
    if squares is None:
        return ()
    return tuple(u.name for u, s in zip(problem.shared, squares, strict=True) if s == 0.0 and u.prior is None)


def _shared_squares(
    problem: Problem, record_local: Sequence[Sequence[Unknown]], moved: float
) -> Floats | None:
    """Sums of squares of the shared unknowns' columns, with the record-level unknowns `moved` by that share
    of their sizes; None if the model cannot be simulated there."""
    start = np.array([unknown.start for unknown in problem.shared])
    local = [
        np.array([min(max(u.start + moved * u.size, u.lower), u.upper) for u in unknowns])
        for unknowns in record_local
    ]
    blocks = problem.evaluate(start, local, derivatives=True)
    if isinstance(blocks, Refused):
        return None
    squares = np.zeros(start.size)
    for block in blocks:
        if block.shared is not None:
            squares += np.square(block.shared).sum(axis=0)
    return squares


def _started(problem: Problem, local: Sequence[Floats] | None) -> list[list[Unknown]]:
    unknowns = problem.local_unknowns()
    if local is None:
        return unknowns
    return [started(record_local, values) for record_local, values in zip(unknowns, local, strict=True)]


def _local_unknowns(
    problem: Problem, values: Floats, indices: Sequence[int], local: Sequence[Floats] | None
) -> dict[int, Floats]:
    """The record-level unknowns, with the shared ones given."""
    if not indices:
        return {}
    # the shared unknowns become part of the base, so that only the records' own are left
    base = problem.base.copy()
    names = problem.compiled.system.parameter_names
    for unknown, value in zip(problem.shared, values, strict=True):
        base[names.index(unknown.name)] = value
    inner = problem.only(indices).with_shared((), base)
    unknowns = _started(inner, None if local is None else [local[k] for k in indices])
    if not any(unknowns):
        return {index: np.empty(0) for index in indices}
    options = Options(cost=_COST)
    result = with_best_switches(inner, least_squares(inner.evaluate, (), unknowns, options=options), options)
    return dict(zip(indices, result.local, strict=True))


def _check_enough(problem: Problem) -> None:
    values = sum(whitener.size for whitener in problem.whiteners)
    free = [unknown.name for unknown in problem.shared if unknown.prior is None]
    wanted = len(free)
    if values < wanted:
        names = ", ".join(free)
        records = len(problem.records)
        raise RigctlError(
            f"{number_of(values, 'measured value')} of {records} "
            f"record{'' if records == 1 else 's'} cannot determine {wanted} parameters: {names}",
            hint="Fit fewer ('fit: false' in the model file), or bring more records",
        )
