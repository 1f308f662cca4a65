"""Formulas in the model: refitted together with all free parameters, and their predictions of unseen records.

The linear problem predicts the gain of a formula; only a refit shows the actual gain, as the scales of the
formula and the model's parameters change. Each scale of the best formulas is started at three or more values.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

from rigctl.analysis.agreement.adequacy import Adequacy, adequacy, variance_factor
from rigctl.analysis.fitting import OnProgress
from rigctl.analysis.linear.candidates import Candidate
from rigctl.analysis.linear.cross_validation import CrossValidation, held_out_gain
from rigctl.analysis.linear.linearisation import linearise
from rigctl.analysis.linear.nuisance_projection import project
from rigctl.analysis.linear.score_test import screen
from rigctl.analysis.search.refit import RefittedSet, refit
from rigctl.discovery.effect_file import effect_of, scale_parameters
from rigctl.discovery.formulas import Formula, numbered
from rigctl.discovery.grammar import DISTANCES
from rigctl.effects.declaration import qualified
from rigctl.engine.one_thread import one_thread
from rigctl.model.fit.fit import FitResult, without_derived
from rigctl.tasks import Countdown, Workers, map_tasks

#: number of formulas that are refitted, and of those that are started at several scales
FIRST, SEVERAL = 12, 4
#: number of other locations whose best formulas are refitted as well
_PLACES = 3
#: number of products whose factors are refitted alone
_PRODUCTS = 2
#: formulas whose cost exceeds that of the best by no more than this are in the set
DELTA = 6.0
#: a formula whose predicted gain is less than this share of the best one's is not refitted; a refit that is
#: this far behind the best, as a share of what that explains and in χ², is not repeated from other scales
_PROMISING, _BEHIND, _APART = 0.6, 0.03, 20.0


@dataclass(frozen=True)
class Fitted:
    """A formula with its fitted size and scales in the model.

    Attributes
    ----------
    formula: size and scales as fitted.
    cost: χ² plus the penalty of the formula.
    """

    formula: Formula
    trial: RefittedSet = field(repr=False)
    cost: float

    @property
    def size_std(self) -> float:
        """Standard deviation of its size, SI; NaN if unknown."""
        return self.trial.value(qualified(self.formula.name, "size"))[1]


@one_thread()
def refit_formulas(
    fit: FitResult,
    formulas: Sequence[Formula],
    samples: float,
    tried: int,
    on_progress: OnProgress,
    workers: Workers | None = None,
) -> tuple[Fitted, ...]:
    """The best formulas in the model, the one with the least cost first.

    Parameters
    ----------
    formulas: by increasing cost, according to the linear problem.
    samples: N_eff; `tried` the number of formulas tried.
    workers: processes that refit them; by default this process, one after the other.
    """
    work = partial(_refitted, without_derived(fit), samples, tried)

    def refitted(pieces: Sequence[tuple[Formula, Formula]], what: str) -> list[Fitted | None]:
        on_progress(what)
        done = Countdown(what, on_progress)
        results = dict(map_tasks(work, pieces, workers or Workers(1), on_progress=done))
        return [results[index] for index in range(len(pieces))]

    # 1. The best of the linear problem, and the best of other locations, each from its own scales.
    first = refitted([(one, one) for one in _chosen(formulas)], "Refitting with formulas")
    fitted = sorted((one for one in first if one is not None), key=lambda one: one.cost)
    # 2. The factors of the best products alone: the second factor may only have made up for an error of the
    #    linear problem.
    parts = _parts(fitted, fit)
    of_parts = refitted([(one, one) for one in parts], "Refitting with one factor") if parts else []
    fitted = sorted([*fitted, *(one for one in of_parts if one is not None)], key=lambda one: one.cost)
    # 3. Those near the best from other scales, since a scale acts nonlinearly and a fit stays in its minimum.
    near = [
        one for one in fitted[:SEVERAL] if one.cost - fitted[0].cost < _APART + _BEHIND * formulas[0].gain
    ]
    pieces = [(one.formula, start) for one in near for start in _other_scales(one.formula)]
    others = refitted(pieces, "Refitting from other scales") if pieces else []
    again = [
        min(
            [
                one,
                *(
                    other
                    for (formula, _), other in zip(pieces, others, strict=True)
                    if formula is one.formula and other is not None
                ),
            ],
            key=lambda each: each.cost,
        )
        for one in fitted[:SEVERAL]
    ]
    return tuple(sorted([*again, *fitted[SEVERAL:]], key=lambda one: one.cost))


def _chosen(formulas: Sequence[Formula]) -> list[Formula]:
    """The formulas of least cost, simpler ones equivalent to the first of them, and the best at each other
    location, so that refits compare locations."""
    promising = [one for one in formulas if one.gain > _PROMISING * formulas[0].gain]
    simpler = [one for one in map(_simpler, promising[:SEVERAL]) if one is not None]
    first = [*promising[: FIRST - len(simpler)], *simpler]
    places = {one.slot.name for one in first}
    for one in promising[FIRST - len(simpler) :]:
        if one.slot.name not in places and len(first) < FIRST + _PLACES:
            places.add(one.slot.name)
            first.append(one)
    return first


def _parts(fitted: Sequence[Fitted], fit: FitResult) -> list[Formula]:
    """The factors of the best products as formulas of their own, with their scales as fitted, and with those
    equivalents of the product that depend on the same variable alone.

    For the linear problem a second factor may compensate for the error of the first one's large effect.
    """
    tried = {one.formula.key for one in fitted}
    products = [one.formula for one in fitted[:SEVERAL] if len(one.formula.factors) > 1]
    parts: dict[str, Formula] = {}
    for formula in products[:_PRODUCTS]:
        for factor in formula.factors:
            part = numbered(replace(formula, factors=(factor,), same=(), number=1), fit.problem.model)
            if part.key not in tried:
                same = [one for one in formula.same if one.over == part.over and one.key != part.key]
                parts.setdefault(part.key, replace(part, same=tuple(same)))
    return list(parts.values())


def _simpler(formula: Formula) -> Formula | None:
    """The best of the equivalent formulas with fewer parameters; None if there is none.

    A cosine of 0.99 is a difference of hundreds in χ² where a term explains tens of thousands: the linear
    problem then decides by its own error, a refit by the data.
    """
    simpler = [one for one in formula.same if one.parameters < formula.parameters]
    if not simpler:
        return None
    best = min(simpler, key=lambda one: one.cost)
    return replace(best, same=(replace(formula, same=()), *(one for one in formula.same if one is not best)))


@one_thread()
def _refitted(fit: FitResult, samples: float, tried: int, piece: tuple[Formula, Formula]) -> Fitted | None:
    """A formula in the model, started at the scales of another of its kind; None if it cannot be fitted."""
    formula, start = piece
    family = fit.problem.model.family
    # The formula as an effect, with one size (the column) and its scales as shape parameters, which `refit`
    # frees once the effect has a size.
    effect = effect_of(formula, family)
    scales = scale_parameters(start, family)
    shapes = {qualified(effect.name, one.name): one.value for one in scales}
    trial = refit(fit, [Candidate(effect, (qualified(effect.name, "size"),), (0,), shapes, {})])
    if trial is None or not math.isfinite(trial.chi2):
        return None
    values = {one.name: trial.value(qualified(effect.name, one.name))[0] for one in scales}
    fitted = start.with_scales(
        [
            (values[one.name] - (0.0 if one.kind in DISTANCES else one.factor.argument.zero))
            / one.factor.argument.reference
            for one in scales
        ]
    )
    size = trial.value(qualified(effect.name, "size"))[0]
    price = formula.price(samples, tried)
    return Fitted(replace(fitted, size=size, cost=trial.chi2 + price), trial, trial.chi2 + price)


def _other_scales(formula: Formula) -> Iterator[Formula]:
    """The formula with other starting values: distances halved and doubled, positions shifted by a tenth."""
    kinds = [(kind, one.argument) for one in formula.factors for kind in one.form.scales]
    for index, (kind, argument) in enumerate(kinds):
        for sign in (-1.0, 1.0):
            scales = list(formula.scales)
            scales[index] = (
                scales[index] * 2.0**sign
                if kind in DISTANCES
                else scales[index] + 0.1 * sign * argument.length
            )
            yield formula.with_scales(scales)


def within(fitted: Sequence[Fitted]) -> tuple[Fitted, ...]:
    """The set: all formulas whose cost exceeds that of the best by no more than `DELTA`.

    Differences are divided by the variance factor of what the best one leaves.
    """
    if not fitted:
        return ()
    best = fitted[0]
    factor = variance_factor(best.trial.fit)
    return tuple(one for one in fitted if (one.cost - best.cost) / factor < DELTA)


def left_out(one: Fitted) -> CrossValidation:
    """Cross-validation of a formula over the conditions."""
    fit = one.trial.fit
    column = qualified(one.formula.name, "size")
    lin = linearise(fit, fit.problem, ())
    return held_out_gain(lin, (column,), [one.formula.size])


def tests_after(one: Fitted) -> Adequacy:
    """Whether the model with the formula agrees with the data."""
    fit = one.trial.fit
    projected = project(linearise(fit, fit.problem, ()))
    return adequacy(projected, screen(projected))
