"""A model with some candidates added: refitted, and judged by its misfit and its number of parameters.

In: the fit without the effects, the candidates, and optionally the fit of another set to start from. Out: a
`RefittedSet`, or None where the model cannot be simulated. A search fits hundreds of sets, so that each
starts from a fit that is known (`_WarmStart`), a set that is far behind the best one is fitted only
coarsely, and bounds of the usual range are left only where they hold the fit.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.agreement.parameter_bounds import (
    beyond_usual,
    in_order,
    ordered,
    ordered_pairs,
    starting_at_fit,
    unusual_text,
    value_of,
)
from rigctl.analysis.decision_levels import INTERVAL
from rigctl.analysis.linear.candidates import Candidate
from rigctl.analysis.linear.mbic import mbic
from rigctl.effects.declaration import qualified
from rigctl.engine.least_squares import Refused, Unknown, started
from rigctl.errors import RigctlError
from rigctl.model.fit.approach import reset_to_priors
from rigctl.model.fit.errors import whitened_residual
from rigctl.model.fit.fit import FitResult, fit
from rigctl.model.fit.problem import Problem

Floats = NDArray[np.float64]

#: a trial on noisy data is fitted until the next step would lower its cost by less than this share
_COST = 1e-5
#: that share where a coarse fit suffices, and the χ² by which a precise fit may still lower its cost
COARSE, NEAR = 1e-3, 40.0
#: a parameter may double in one step: an effect starts at its null, far below its size
STEP = 1.0
#: only a set whose χ² is less than this multiple of the best one's may be in a local minimum that matters
_BEHIND = 1.1
#: distance from its bounds at which an effect's parameter starts, as a share of their distance
ROOM = 1e-6


@dataclass(frozen=True)
class RefittedSet:
    """A set of effects added to the model, refitted together with the model's own parameters.

    Attributes
    ----------
    candidates: the effects with their shapes; none for the model as given.
    fit: of the model with the effects, their parameters among its shared unknowns.
    chi2: sum of the squared whitened residuals and of the priors' residuals.
    parameters: number of parameters of the effects, including those that ended at a bound.
    """

    candidates: tuple[Candidate, ...]
    fit: FitResult = field(repr=False)
    chi2: float
    parameters: int

    @property
    def effects(self) -> tuple[str, ...]:
        """Their names."""
        return tuple(candidate.name for candidate in self.candidates)

    def mbic(self, samples: float, library: int) -> float:
        """Its mBIC, see `rigctl.analysis.linear.mbic.mbic`."""
        return mbic(self.chi2, self.parameters, len(self.candidates), samples, library)

    @property
    def unusual(self) -> dict[str, str]:
        """By effect, in words, its parameters outside their usual range; empty if there are none."""
        texts = {one.name: unusual_text(self.fit, one) for one in self.candidates}
        return {name: text for name, text in texts.items() if text}

    @property
    def undetermined(self) -> tuple[str, ...]:
        """The effects of which the 95 % interval of every parameter that switches them on contains its null.

        An effect with several parameters may reduce χ² considerably without any of them being determined:
        only a combination is, which is then that of many laws.
        """
        return tuple(one.name for one in self.candidates if not self._determined(one))

    def _determined(self, candidate: Candidate) -> bool:
        sizes = [name for name in candidate.columns if not candidate.parameter(name).shape]
        away = [(self.value(name), candidate.parameter(name).at_null) for name in sizes]
        return not away or any(
            value != null and not abs(value - null) <= INTERVAL * std for (value, std), null in away
        )

    def value(self, column: str) -> tuple[float, float]:
        """A parameter of an effect and its standard deviation, SI; NaN for that if it acts on no reading."""
        return value_of(self.fit, column), self.fit.std.get(column, math.nan)

    def reported(self, column: str) -> tuple[float, float]:
        """As `value`, with the standard deviation that users are told: see `FitResult.reported_std`."""
        return value_of(self.fit, column), self.fit.reported_std.get(column, math.nan)

    def amplitudes(self, candidate: Candidate) -> Floats:
        """(columns) the parameters of one of its effects less their null, SI."""
        return np.array(
            [self.value(name)[0] - candidate.parameter(name).at_null for name in candidate.columns]
        )


def plain(fitted: FitResult) -> RefittedSet:
    """The model itself, as fitted."""
    solution = fitted.solution
    return RefittedSet((), fitted, 2.0 * solution.cost if solution is not None else _chi2(fitted), 0)


def refit(
    fitted: FitResult,
    chosen: Sequence[Candidate],
    begin: FitResult | None = None,
    *,
    at: Mapping[str, float] | None = None,
    cost: float = _COST,
    rival: float = math.inf,
    usual: bool = False,
) -> RefittedSet | None:
    """Fit the model's parameters and those of `chosen`; None if that is not possible.

    Effects that `begin` does not have start at their null, where the misfit is unchanged. Started at the size
    given by the linear problem, an effect that the fitted parameters nearly imitate would start far away, and
    the fit would end in the valley between. A fit that ends at a limit of the usual range is continued beyond
    it; one that violates an order of an effect's parameters is repeated within that order.

    Parameters
    ----------
    fitted: of the model with none of the effects.
    begin: the fit of another set, from which the unknowns start; `fitted` by default, or if that has the
        smaller misfit: parameters fitted beside an effect compensate for it, and are far off without it.
    at: the parameters of an effect, SI, at which it equals its limiting case, which `begin` has in its place:
        the fit starts there.
    cost: the fit ends when the next step would lower the cost by less than this share.
    rival: the least cost of the sets known: a set far behind it is fitted only coarsely.
    usual: keep to the limits of the usual range.
    """
    try:
        # 1. The equations with the effects, starting from the nearest fit that is known.
        model = fitted.at_end
        for candidate in chosen:
            model = model.with_effect(candidate.effect, starting_values(candidate))
        problem = _in_both_ranges(fitted.problem.rebuilt(model), fitted.problem)
        known = fitted if begin is None else begin if at else _better_start(problem, begin, fitted)
        shared = _started(problem, known, at)
        # 2. The fit. With `at` the effect starts at its limiting case, where the order of its parameters is a
        #    bound: a fit that stays on it (`limited`) is that limiting case, and neither bound nor order need
        #    be tried again.
        warm_start = _WarmStart(problem.with_shared(ordered(shared, chosen) if at else shared), known)
        refitted = warm_start.fitted(fitted.held_out, cost, rival)
        limited = at is not None and _at_limit(refitted, chosen)
        if at is not None and not limited and refitted.at_bound & at.keys():
            refitted = _again(refitted, starting_at_fit(refitted, {one.name: one for one in shared}), cost)
        # 3. Shape parameters, which were fixed so far, are freed where the declaration allows: they act on
        #    nothing before the effect has a size.
        refitted, more = _refined(refitted, chosen, cost)
    except RigctlError:  # the model cannot be simulated, or contradicts itself: no explanation
        return None
    # 4. Bounds come last: a wider range is tried, or an order enforced, only where the free fit needs it.
    if not limited:
        if not usual:
            refitted = _again(refitted, beyond_usual(refitted, chosen), cost)
        refitted = _again(refitted, in_order(refitted, chosen), cost, forced=True)
    assert refitted.solution is not None  # noqa: S101 - there is something to fit
    columns = more + sum(len(candidate.columns) for candidate in chosen)
    return RefittedSet(tuple(chosen), refitted, 2.0 * refitted.solution.cost, columns)


def at_limiting_case(candidate: Candidate, simpler: Candidate) -> dict[str, str | float] | None:
    """For each parameter of an effect, its value where it equals a simpler effect: a parameter of that one,
    or a number, SI; None if that is not a limiting case of it with the same shape parameters."""
    limits = {name: limit for name, limit, law in candidate.effect.becomes if law == simpler.name}
    if not limits or not _same_shapes(candidate, simpler):
        return None
    sources: dict[str, str | float] = {}
    for column in candidate.columns:
        name = column.partition(".")[2]
        limit = limits.get(name, name)
        sources[column] = qualified(simpler.name, limit) if isinstance(limit, str) else limit
    parameters = {source for source in sources.values() if isinstance(source, str)}
    return sources if parameters == set(simpler.columns) else None


def _same_shapes(one: Candidate, other: Candidate) -> bool:
    """Whether the shape parameters that two effects have in common have the same values."""
    first, second = (
        {
            declared.name: candidate.shapes.get(qualified(candidate.name, declared.name), declared.start)
            for declared in candidate.effect.parameters
            if declared.shape
        }
        for candidate in (one, other)
    )
    return all(first[name] == second[name] for name in first.keys() & second.keys())


@dataclass(frozen=True)
class _WarmStart:
    """A problem that starts from the fit `known` of fewer effects."""

    problem: Problem
    known: FitResult

    def fitted(self, held_out: Sequence[int], cost: float, rival: float) -> FitResult:
        """The fit, as `rigctl.model.fit.fit.fit`.

        Unknowns far from their priors have compensated for what the effects explain, and may keep the fit in
        a local minimum: it is repeated, coarsely, with those parameters of the model reset that still are
        far, and, where any unknown of a record was far without the effects, with all of the records' unknowns
        reset; the best one is continued.
        """
        # The parameters of a model that lacks an effect have compensated for it. If one of them, or a
        # record's own unknown, is far from its prior, the fit may be in a valley that leads to another
        # minimum than the true one.
        start = np.array([one.start for one in self.problem.shared])
        records_far = self._records_back(self.known.local) is not None
        if reset_to_priors(self.problem.shared, start) is None and not records_far:
            return self._fit(self.problem.shared, self.known.local, held_out, cost, rival)
        # Coarse fits find the deeper minimum, a precise one follows only from there. Other starts are not
        # worth their cost for a set that is far behind the best one.
        better = self._fit(self.problem.shared, self.known.local, held_out, COARSE, rival)
        if chi2_of(better) < min(chi2_of(self.known) - NEAR, _BEHIND * 2.0 * rival):
            back = reset_to_priors(better.problem.shared, better.values)
            if back is not None:
                better = self._lower(better, back, better.local, held_out)
            local = self._records_back(better.local)
            if local is not None:
                initial = started(better.problem.shared, better.values)
                better = self._lower(better, initial, local, held_out)
        initial = started(better.problem.shared, better.values)
        return self._fit(initial, better.local, held_out, cost, rival)

    def _lower(
        self, better: FitResult, shared: Sequence[Unknown], local: Sequence[Floats], held_out: Sequence[int]
    ) -> FitResult:
        """The better one of a fit and a coarse one from another start."""
        with suppress(RigctlError):  # the model cannot be simulated there
            again = self._fit(shared, local, held_out, COARSE, 0.5 * chi2_of(better))
            return again if chi2_of(again) < chi2_of(better) else better
        return better

    def _records_back(self, local: Sequence[Floats]) -> list[Floats] | None:
        """`local` with the priors' means; None if no unknown of a record is far from its prior in the fit
        without the effects."""
        unknowns = self.problem.local_unknowns()
        if all(reset_to_priors(*pair) is None for pair in zip(unknowns, self.known.local, strict=True)):
            return None
        return [
            np.array(
                [
                    value if one.prior is None else min(max(one.prior.mean, one.lower), one.upper)
                    for one, value in zip(each, values.tolist(), strict=True)
                ]
            )
            for each, values in zip(unknowns, local, strict=True)
        ]

    def _fit(
        self,
        shared: Sequence[Unknown],
        local: Sequence[Floats],
        held_out: Sequence[int],
        cost: float,
        rival: float,
    ) -> FitResult:
        problem = self.problem.with_shared(shared)
        return fit(problem, held_out, local=local, cost=cost, largest_step=STEP, rival=rival)


def _at_limit(fitted: FitResult, chosen: Sequence[Candidate]) -> bool:
    """Whether the order of an effect's parameters holds both of a pair at their common bound."""
    return any(set(pair) <= fitted.at_bound for pair in ordered_pairs(chosen))


def left_by_refit(fitted: FitResult, outside: Sequence[int], cost: float = _COST) -> float | None:
    """Sum of squared whitened residuals on the records `outside`, with the model fitted to the others.

    The record-level unknowns of `outside` are fitted to their own records; what that costs by their priors is
    not included. None if the model cannot be simulated on the way.
    """
    problem = fitted.problem.with_shared(started(fitted.problem.shared, fitted.values))
    hold_out = [*fitted.held_out, *outside]
    try:
        refitted = fit(problem, hold_out, local=fitted.local, cost=cost, largest_step=STEP)
    except RigctlError:
        return None
    rows = [whitened_residual(refitted.problem, refitted.outputs[k], k) for k in outside]
    return sum(float(one @ one) for one in rows)


def _refined(fitted: FitResult, chosen: Sequence[Candidate], cost: float) -> tuple[FitResult, int]:
    """The fit with those shape parameters free that may be refined, and their number; if that improves it.

    Only once the effect is in the model: at its null a shape parameter does nothing.
    """
    names = {
        (one.name, parameter.name)
        for one in chosen
        for parameter in one.effect.parameters
        if parameter.refined and parameter.shape
    }
    if not names:
        return fitted, 0
    model = fitted.at_end
    free = {
        effect: {
            name: replace(value, fit=value.fit or (effect, name) in names) for name, value in values.items()
        }
        for effect, values in model.effects.items()
    }
    problem = _in_both_ranges(fitted.problem.rebuilt(replace(model, effects=free)), fitted.problem)
    problem = problem.with_shared(_started(problem, fitted))
    try:
        better = fit(problem, fitted.held_out, local=fitted.local, cost=cost, largest_step=STEP)
    except RigctlError:
        return fitted, 0
    samples = sum(int(problem.ok[k].sum()) for k in fitted.fitted)
    pays = chi2_of(fitted) - chi2_of(better) > len(names) * math.log(max(samples, 2))
    return (better, len(names)) if pays else (fitted, 0)


def chi2_of(fitted: FitResult) -> float:
    """χ² that a fit leaves, including the priors'."""
    return plain(fitted).chi2


def _again(
    fitted: FitResult, shared: list[Unknown] | None, cost: float, *, forced: bool = False
) -> FitResult:
    """The fit repeated with other bounds, or the given fit if the new one is no better.

    With `forced` the new fit is returned in any case.
    """
    if shared is None:
        return fitted
    try:
        problem = fitted.problem.with_shared(shared)
        again = fit(problem, fitted.held_out, local=fitted.local, cost=cost, largest_step=STEP)
    except RigctlError:  # the model cannot be simulated there
        return fitted
    assert again.solution is not None and fitted.solution is not None  # noqa: S101 - both have parameters
    return again if forced or again.solution.cost < fitted.solution.cost else fitted


def starting_values(candidate: Candidate) -> dict[str, float]:
    """Starting values of the effect's parameters: their null, or the size at which they were detected, but
    never at a bound, which a fit would first have to leave."""
    values = {}
    for column in candidate.columns:
        declared = candidate.parameter(column)
        room = ROOM * (declared.high - declared.low)
        values[declared.name] = min(max(declared.at_null, declared.low + room), declared.high - room)
    chosen = {**candidate.secants, **candidate.shapes}
    return values | {name.partition(".")[2]: value for name, value in chosen.items()}


def _in_both_ranges(problem: Problem, before: Problem) -> Problem:
    """The problem with the parameters that `before` has too bounded no more narrowly than there.

    Bounds that are not declared are multiples of a parameter's value. About a fitted value that compensates
    for what the model lacks, they may exclude the right one: viscous damping in place of dry friction.
    """
    known = {one.name: one for one in before.shared}
    return problem.with_shared(
        [
            one
            if one.name not in known
            else replace(
                one,
                lower=min(one.lower, known[one.name].lower),
                upper=max(one.upper, known[one.name].upper),
            )
            for one in problem.shared
        ]
    )


def _started(problem: Problem, fitted: FitResult, at: Mapping[str, float] | None = None) -> list[Unknown]:
    """The unknowns of a larger model, those of the smaller one starting where its fit ended, others `at`."""
    known = {u.name: float(v) for u, v in zip(fitted.problem.shared, fitted.values, strict=True)}
    known |= at or {}
    return [replace(u, start=min(max(known.get(u.name, u.start), u.lower), u.upper)) for u in problem.shared]


def _better_start(problem: Problem, begin: FitResult, fitted: FitResult) -> FitResult:
    """The starting point with the smaller misfit: `begin`, which has an effect more, or `fitted`."""
    if not set(begin.model.effects) - set(problem.model.effects):
        return begin

    def misfit(known: FitResult) -> float:
        start = np.array([unknown.start for unknown in _started(problem, known)])
        inner = problem.only(fitted.fitted)
        blocks = inner.evaluate(start, [known.local[k] for k in fitted.fitted], False)
        if isinstance(blocks, Refused):
            return math.inf
        return sum(float(block.residual @ block.residual) for block in blocks)

    return min((begin, fitted), key=misfit)


def _chi2(fitted: FitResult) -> float:
    return fitted.chi2_reduced * sum(fitted.problem.whiteners[k].size for k in fitted.fitted)
