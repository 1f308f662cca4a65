"""The remaining explanations: which they are, how probable, and how well each is determined.

In: a diagnosis, or names given by the user. Out: a `Question`: the aim of the design, at most five rivals,
each refitted to all data so far, and the pairs of them that are to be distinguished. The verdict decides
what the question is, so that a design continues where the diagnosis ended.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.comparison_result import ModelComparison
from rigctl.analysis.decision_levels import ODDS
from rigctl.analysis.diagnosis_result import Diagnosis, FoundParameter, Verdict
from rigctl.analysis.linear.candidates import Candidate, candidates, data_ranges
from rigctl.analysis.linear.mbic import effective_samples
from rigctl.analysis.linear.power import hidden_at_typical_size
from rigctl.analysis.search.refit import RefittedSet, plain, refit
from rigctl.design.refusals import NothingLeft
from rigctl.design.result import NONE, Aim, DesignRival
from rigctl.effects.declaration import qualified
from rigctl.engine.least_squares import Unknown
from rigctl.errors import RigctlError, unknown_name
from rigctl.model.fit.fit import FitResult
from rigctl.model.model import Model

Floats = NDArray[np.float64]

#: largest number of rivals in a design, including `none`; the least probable are left out
MOST_RIVALS = 5
#: least weight of a pair that was requested
_LEAST_WEIGHT = 0.1
#: an effect with at least this probability is accepted: what remains is to determine its parameters
_WON = 0.95
#: standard deviation of an unknown without a prior, as a multiple of its typical size
_VAGUE = 100.0


@dataclass(frozen=True)
class Rival:
    """An explanation, fitted to all data so far.

    Attributes
    ----------
    name: of the effect in question, or ``none``.
    trial: the set of effects, refitted.
    mbic: of the trial.
    weight: its probability among the rivals.
    noise: χ² per degree of freedom by which the noise is scaled; by default that of its own fit. For an
        effect at its usual size, which is not fitted, that of the model without it.
    """

    name: str
    trial: RefittedSet = field(repr=False)
    mbic: float
    weight: float
    noise: float | None = None

    @property
    def fit(self) -> FitResult:
        """The model with its effects."""
        return self.trial.fit

    @property
    def overdispersion(self) -> float:
        """χ² per degree of freedom, at least 1."""
        return max(1.0, self.fit.chi2_reduced if self.noise is None else self.noise)

    @property
    def sizes(self) -> Floats:
        """(p) typical sizes of the common unknowns, SI, by which their derivatives are scaled."""
        return np.array([unknown.size for unknown in self.fit.problem.shared])

    def contains(self, other: Rival) -> bool:
        """Whether it becomes the other one at a limit of its parameters: then no data distinguish them.

        Of models that a user gave, only those that are the same with further effects are known to.
        """
        if not self.trial.candidates and not other.trial.candidates and self.name != NONE != other.name:
            return _extends(self.fit.problem.model, other.fit.problem.model)
        mine, others = {*self.trial.effects}, {*other.trial.effects}
        if others <= mine:
            return True
        (more, *rest), known = [*(mine - others), ""], others - mine
        laws = [law for one in self.trial.candidates if one.name == more for _, _, law in one.effect.becomes]
        return rest == [""] and len(known) == 1 and known <= set(laws)

    def prior_information(self) -> Floats:
        """(p, p) prior information about the common unknowns, scaled by `sizes`."""
        return np.diag([(unknown.size / _spread(unknown)) ** 2 for unknown in self.fit.problem.shared])

    def described(self) -> DesignRival:
        """The rival as shown in a result."""
        fit = self.fit
        return DesignRival(
            name=self.name,
            effects=self.trial.effects,
            weight=self.weight,
            parameters=_parameters(self.trial),
            chi2=self.trial.chi2,
            chi2_reduced=fit.chi2_reduced,
            std=fit.std,
        )


def _extends(model: Model, other: Model) -> bool:
    """Whether a model is another one with further effects that a fit can switch off, and nothing else."""
    further = [name for name in model.effects if name not in other.effects]
    values, free = model.values, {*model.fitted}
    return (
        model.same_bench(other)
        and {*other.effects} <= {*model.effects}
        and all(model.effect(name) == other.effect(name) for name in other.effects)
        and {*other.fitted} <= free
        and all(values[name] == value for name, value in other.values.items() if name not in free)
        and all(
            qualified(name, one.name) in free or values[qualified(name, one.name)] == one.null
            for name in further
            for one in model.effect(name).parameters
            if one.null is not None
        )
    )


@dataclass(frozen=True)
class Basis:
    """What a question was found in.

    Attributes
    ----------
    runs: their ids.
    model: its name; of several, all of them.
    diagnosis: of the model; None for a choice between models.
    excluded: names of models between which there is no choice any more.
    """

    runs: tuple[str, ...]
    model: str
    diagnosis: Diagnosis | None = None
    excluded: tuple[str, ...] = ()

    @classmethod
    def of(cls, diagnosis: Diagnosis) -> Basis:
        """A diagnosis, which leaves the question open."""
        return cls(diagnosis.runs, diagnosis.model, diagnosis)


@dataclass(frozen=True)
class Question:
    """The question for the next experiment.

    Attributes
    ----------
    aim: of the design.
    rivals: the most probable first.
    pairs: (truth, rival) indices of the rivals to be distinguished.
    library: K, the number of effects searched.
    columns: for aim ``precision``, the unknowns to be estimated better.
    alike: pairs of names that the data so far do not distinguish, according to the diagnosis.
    """

    aim: Aim
    rivals: tuple[Rival, ...]
    pairs: tuple[tuple[int, int], ...]
    library: int
    columns: tuple[str, ...] = ()
    alike: frozenset[frozenset[str]] = frozenset()


def question_of(
    diagnosis: Diagnosis, separate: tuple[str, str] | None = None, precise: Collection[str] = ()
) -> Question:
    """What a diagnosis leaves open.

    Parameters
    ----------
    separate: two names to be distinguished instead.
    precise: effects of the model whose sizes are to be estimated better instead.

    Raises
    ------
    NothingLeft
        nothing is left open.
    RigctlError
        `separate` names no effect of the library, or `precise` none of the model's.
    """
    if separate is not None:
        return _requested(diagnosis, separate)
    return _sizes_of(diagnosis, precise) if precise else _left_open(diagnosis)


def _left_open(diagnosis: Diagnosis) -> Question:
    """The question that follows from the verdict."""
    if diagnosis.instead_of_sensors:
        # with the errors of sensors free in every rival: what distinguishes them is what no error within the
        # stated calibrations imitates
        return _between(diagnosis, "discrimination", set(diagnosis.instead_of_sensors))
    # What is open follows from the verdict, in this order: names that are not distinguished; else the size of
    # what is named; else what may be there unseen; else the most probable names of a search that named none.
    classes = [names for names in diagnosis.classes if len(names) > 1]
    if classes:
        return _between(diagnosis, "discrimination", {name for names in classes for name in names})
    if diagnosis.verdict in (Verdict.MISSING_EFFECT, Verdict.AMBIGUOUS) and _leads(diagnosis):
        return _size_of_best(diagnosis)
    if diagnosis.verdict in (Verdict.ADEQUATE, Verdict.UNDECIDED):
        return _unseen(diagnosis)
    if diagnosis.verdict is Verdict.OUTSIDE_LIBRARY and diagnosis.remainder is not None:
        raise NothingLeft(
            "no effect of the library explains these data: a record would only distinguish wrong ones",
            hint="'rigctl discover' looks for a formula; "
            "'--separate A,B' designs for two effects of your choice",
        )
    likely = [one.effect for one in diagnosis.ranking if one.probability > 1.0 / ODDS]
    tried = {name for trial in diagnosis.trials for name in trial.effects}
    names = {*diagnosis.best.effects, *(n for n in likely if n in tried)}
    if diagnosis.verdict is Verdict.AMBIGUOUS and len(names) < 2:
        return _size_of_best(diagnosis)  # without rivals, what remains to be tested is its prediction
    return _between(diagnosis, "discrimination", names)


def require_names(model: Model, separate: tuple[str, str]) -> None:
    """Refuse names that cannot be distinguished, before any work is done.

    Raises
    ------
    RigctlError
        a name is no effect that the model may lack, or the same is given twice.
    """
    known = [NONE, *dict.fromkeys(one.name for one in candidates(model))]
    for name in separate:
        if name not in known:
            raise unknown_name("effect", name, known)
    if separate[0] == separate[1]:
        raise RigctlError(
            "an effect cannot be distinguished from itself", value=separate[0], expected="two names"
        )


def _size_of_best(diagnosis: Diagnosis) -> Question:
    """The size of the accepted effects: their parameters, given the data so far and the model with them."""
    best = _rival_of(diagnosis, " + ".join(diagnosis.best.effects), diagnosis.best)
    free = {unknown.name for unknown in best.fit.problem.shared}
    columns = tuple(
        column for candidate in best.trial.candidates for column in candidate.columns if column in free
    )
    return Question("precision", (best,), (), _library(diagnosis), columns)


def _sizes_of(diagnosis: Diagnosis, names: Collection[str]) -> Question:
    """The sizes of effects that the model already has."""
    fitted = diagnosis.before.fit
    model = fitted.problem.model
    for name in names:
        if name not in model.effects:
            raise unknown_name("effect of this model", name, model.effects)
    columns = tuple(
        unknown.name
        for unknown in fitted.problem.shared
        if unknown.name.partition(".")[0] in names and "." in unknown.name
    )
    if not columns:
        raise NothingLeft(
            f"nothing of {' and '.join(names)} is fitted, so that no record improves its estimate",
            value=diagnosis.model,
            hint="'fit: true' beside a parameter in the model file lets it be fitted",
        )
    rival = _rival_of(diagnosis, " + ".join(names), plain(fitted))
    return Question("precision", (rival,), (), _library(diagnosis), columns)


def _leads(diagnosis: Diagnosis) -> bool:
    of = {one.effect: one.probability for one in diagnosis.ranking}
    return all(of.get(name, 0.0) >= _WON for name in diagnosis.effects)


def _between(diagnosis: Diagnosis, aim: Aim, names: Collection[str]) -> Question:
    """Each of `names` in its best set, and the model without: all pairs that are not yet distinguished.

    The model without is never the one that is to be found right: every effect becomes it at size zero.
    """
    # Every name in its best set, and the model without any of them, weighed by mBIC; the least probable are
    # dropped.
    candidates = [_rival_of(diagnosis, name, _trial_of(diagnosis, name)) for name in sorted(names)]
    candidates.append(_rival_of(diagnosis, NONE, _without(diagnosis, names)))
    rivals = weighed(candidates)
    if len(rivals) < 2 or not names:
        raise nothing_left(diagnosis)
    if diagnosis.instead_of_sensors:
        rivals = _effects_first(rivals)
    open_names = {*names} | ({NONE} if diagnosis.verdict is not Verdict.AMBIGUOUS else set())
    pairs = [
        (i, j)
        for i, one in enumerate(rivals)
        for j, other in enumerate(rivals)
        if i != j
        and one.name != NONE
        and {one.name, other.name} <= open_names
        and one.trial is not other.trial
    ]
    if not pairs:  # all names are members of the best set: what remains open is its prediction
        return _size_of_best(diagnosis)
    return Question(aim, rivals, tuple(pairs), _library(diagnosis), alike=_alike(diagnosis))


def _alike(diagnosis: Diagnosis) -> frozenset[frozenset[str]]:
    return frozenset(
        frozenset(pair) for names in diagnosis.classes for pair in combinations(sorted(names), 2)
    )


def _requested(diagnosis: Diagnosis, separate: tuple[str, str]) -> Question:
    """Two names requested to be distinguished, regardless of the diagnosis."""
    candidates = []
    for name in separate:
        (other,) = {*separate} - {name}
        trial = plain(diagnosis.before.fit) if name == NONE else _trial_of(diagnosis, name, without=other)
        candidates.append(_rival_of(diagnosis, name, trial))
    rivals = weighed(candidates, least=_LEAST_WEIGHT)
    pairs = ((0, 1), (1, 0))
    return Question("discrimination", rivals, pairs, _library(diagnosis), alike=_alike(diagnosis))


def _unseen(diagnosis: Diagnosis) -> Question:
    """Effects that might be present at their usual size without being detected: each against none."""
    # Effects that these data would probably miss although they are there; without those that no data of this
    # kind show. Their parameters are at typical values, since nothing is known of them.
    hidden = hidden_at_typical_size(diagnosis.before.projected)
    silent = set(diagnosis.before.screening.untestable)
    scores = sorted(diagnosis.before.screening.scores, key=lambda one: one.p_value)
    names = [one.effect for one in scores if one.effect in hidden and one.effect not in silent]
    candidates = [_rival_of(diagnosis, NONE, plain(diagnosis.before.fit))]
    for name in names[: MOST_RIVALS - 1]:
        trial = at_usual_size(diagnosis.before, name)
        if trial is not None:
            candidates.append(replace(_rival_of(diagnosis, name, trial), noise=candidates[0].overdispersion))
    if len(candidates) < 2:
        raise nothing_left(diagnosis)
    share = 1.0 / (len(candidates) - 1)
    rivals = tuple(replace(one, weight=0.0 if one.name == NONE else share) for one in candidates)
    return Question("detection", rivals, tuple((k, 0) for k in range(1, len(rivals))), _library(diagnosis))


def nothing_left(
    diagnosis: Diagnosis, hint: str = "'--separate A,B' designs for two effects of your choice"
) -> NothingLeft:
    """The refusal if a diagnosis leaves nothing open."""
    return NothingLeft(
        f"nothing is left to distinguish: {diagnosis.title.lower()}",
        value=diagnosis.model,
        hint=hint,
    )


def _trial_of(diagnosis: Diagnosis, name: str, without: str = "") -> RefittedSet:
    """The best of the sets that contain an effect, and not the one `without`; fitted now if none was."""
    base = set(diagnosis.best.effects)
    tried = (diagnosis.best, *diagnosis.trials)
    holding = [one for one in tried if name in one.effects and without not in one.effects]
    beside = [one for one in holding if len({*one.effects} - base - {name}) == 0] or holding
    if beside:
        samples, library = _price(diagnosis)
        return min(beside, key=lambda one: one.mbic(samples, library))
    chosen = [one for one in _candidates(diagnosis.before) if one.name == name]
    fitted = [refit(diagnosis.before.fit, [one]) for one in chosen]
    good = [one for one in fitted if one is not None]
    if not good:
        raise RigctlError(f"the model cannot be fitted with {name}", value=diagnosis.model)
    return min(good, key=lambda one: one.chi2)


def _without(diagnosis: Diagnosis, names: Collection[str]) -> RefittedSet:
    """The best set without any of `names`."""
    samples, library = _price(diagnosis)
    rest = {*diagnosis.best.effects} - {*names}
    refits = [one for one in diagnosis.trials if {*one.effects} == rest] if rest else []
    return min([plain(diagnosis.before.fit), *refits], key=lambda one: one.mbic(samples, library))


def at_usual_size(before: ModelComparison, name: str) -> RefittedSet | None:
    """An effect at its usual size in the model as fitted, not refitted, because it is not visible.

    Unknowns that the fit left out because they act on no measurement keep the model's values. None if the
    model cannot be simulated there.
    """
    fitted = before.fit
    # those that the data so far cannot show at all, a drift with what never varied, come last
    every = [*_candidates(before), *candidates(fitted.problem.model, before.excluded)]
    candidate = {one.name: one for one in reversed(every)}[name]
    sizes = {column.partition(".")[2]: candidate.parameter(column).start for column in candidate.columns}
    shapes = {column.partition(".")[2]: value for column, value in candidate.shapes.items()}
    try:
        problem = fitted.problem.rebuilt(fitted.at_end.with_effect(candidate.effect, {**shapes, **sizes}))
    except RigctlError:
        return None
    known = {u.name: float(v) for u, v in zip(fitted.problem.shared, fitted.values, strict=True)}
    free = [one for one in problem.shared if one.name in known or one.name in candidate.columns]
    problem = problem.with_shared(free)
    values = np.array([known.get(unknown.name, unknown.start) for unknown in problem.shared])
    simulated = problem.simulate(values, fitted.local)
    if not simulated.ok:
        return None
    outputs = tuple(np.take(array, problem.channels, axis=1) for array in simulated.outputs)
    at_size = FitResult(problem, fitted.fitted, None, values, fitted.local, outputs)
    return RefittedSet((candidate,), at_size, plain(fitted).chi2, len(candidate.columns))


def _rival_of(diagnosis: Diagnosis, name: str, trial: RefittedSet) -> Rival:
    return Rival(name, trial, trial.mbic(*_price(diagnosis)), 1.0)


def weighed(candidates: Sequence[Rival], least: float = 0.0, most: int | None = None) -> tuple[Rival, ...]:
    """With ``exp(−ΔmBIC/2)`` as weights, the most probable first, no more than `most` or `MOST_RIVALS`."""
    best = min(one.mbic for one in candidates)
    factor = min(candidates, key=lambda one: one.mbic).overdispersion
    weights = [max(math.exp(-0.5 * min((one.mbic - best) / factor, 1400.0)), least) for one in candidates]
    weighted = [replace(one, weight=weight) for one, weight in zip(candidates, weights, strict=True)]
    likeliest = sorted(weighted, key=lambda one: (-one.weight, one.name))[: most or MOST_RIVALS]
    total = sum(one.weight for one in likeliest)
    return tuple(replace(one, weight=one.weight / total) for one in likeliest)


def _effects_first(rivals: Sequence[Rival]) -> tuple[Rival, ...]:
    """With the probabilities of the effects among themselves: that of a wrong sensor is stated, not found."""
    effects = [one for one in rivals if one.name != NONE]
    total = sum(one.weight for one in effects)
    return (
        *(replace(one, weight=one.weight / total) for one in effects),
        *(replace(one, weight=0.0) for one in rivals if one.name == NONE),
    )


def _candidates(before: ModelComparison) -> tuple[Candidate, ...]:
    model = before.fit.problem.model
    return candidates(model, before.excluded, data_ranges(model.family, before.whole.measurements))


def _library(diagnosis: Diagnosis) -> int:
    return len({candidate.name for candidate in diagnosis.before.linearisation.candidates})


def _price(diagnosis: Diagnosis) -> tuple[float, int]:
    """The arguments of mBIC: the effective sample size, and the number of effects searched."""
    return effective_samples(diagnosis.before.fit), _library(diagnosis)


def _spread(unknown: Unknown) -> float:
    """The prior standard deviation of an unknown."""
    if unknown.prior is not None:
        return unknown.prior.std
    width = unknown.upper - unknown.lower
    return min(_VAGUE * unknown.size, width) if math.isfinite(width) else _VAGUE * unknown.size


def _parameters(trial: RefittedSet) -> dict[str, FoundParameter]:
    parameters = {}
    for candidate in trial.candidates:
        for column in candidate.columns:
            parameters[column] = FoundParameter.of(candidate.parameter(column), *trial.reported(column))
    return parameters
