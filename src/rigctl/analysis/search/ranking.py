"""The effects of a library by probability, each with what it explains and its fitted parameters.

In: a search and its best set. Out: `Ranked` effects. A probability belongs to a set, ``exp(−mBIC/2)`` over
all sets that were tried, and that of an effect is the sum over the sets that have it. It holds given that
one of them is right: whether any is, the verdict says.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from rigctl.analysis.agreement.adequacy import variance_factor
from rigctl.analysis.decision_levels import ALPHA
from rigctl.analysis.diagnosis_result import FoundParameter, Ranked
from rigctl.analysis.linear.candidates import Candidate
from rigctl.analysis.linear.cross_validation import CrossValidation
from rigctl.analysis.linear.score_test import Score
from rigctl.analysis.linear.separability import softened
from rigctl.analysis.search.refit import RefittedSet
from rigctl.analysis.search.search import Search
from rigctl.effects.declaration import qualified
from rigctl.model.fit.assumptions import conditional_numbers

#: least number of effects of a ranking that are shown
_SHOWN = 12


def most_visible(search: Search, ranking: Sequence[Ranked]) -> Ranked | None:
    """The refitted effect with the lowest mBIC, where only the score test rejects and no set lowers mBIC.

    None if another test rejects as well: no effect has explained what that test sees.
    """
    tests = search.before.adequacy.tests
    rejecting = {name for name, test in tests.items() if len(tests) * test.p_value < ALPHA}
    refitted = {trial.effects[0] for trial in search.trials.values() if len(trial.effects) == 1}
    tried = [one for one in ranking if one.effect in refitted and one.size > 0.0]
    return min(tried, key=lambda one: one.delta_bic, default=None) if rejecting == {"score"} else None


def ranking_of(
    search: Search, best: RefittedSet, checks: Mapping[str, CrossValidation | None]
) -> list[Ranked]:
    """Effects with their probabilities over all sets that were tried, the empty set among them."""
    return [_with_check(one, checks.get(one.effect)) for one in _ranking(search, best)]


def _ranking(search: Search, best: RefittedSet) -> list[Ranked]:
    """Without their cross-validations."""
    trials = [search.null, *search.trials.values()]
    # 1. mBIC of every set: as refitted, else as promised by its score.
    refitted = {trial.effects[0] for trial in trials if len(trial.effects) == 1}
    screened = [score for score in search.before.screening.scores if score.effect not in refitted]
    sets: dict[tuple[str, ...], float] = {}
    for trial in trials:  # if a set was fitted with several shapes, the best counts
        if len(trial.effects) > len(best.effects) > 0:
            continue  # what it explains beyond the best set, that set's shape tolerance may explain too
        key = tuple(sorted(trial.effects))
        sets[key] = min(sets.get(key, math.inf), search.mbic(trial))
    tried = search.before.linearisation.candidates
    for score in screened:
        price = search.price(tried[score.candidate])
        sets[(score.effect,)] = search.mbic(search.null) - search.promised(score) + price
    # 2. Weights exp(−ΔmBIC/2). ΔmBIC is divided by the shape tolerance of a large effect, or by the long-run
    #    variance of what the best set leaves: with many samples the noise alone would make every difference
    #    certain. A set better than the best one is so by less than the shape tolerance allows, or it would be
    #    the best, and counts as equal. The cap keeps `exp` above its underflow.
    least = search.mbic(best)
    less = max(softened(search.null.chi2 - best.chi2), _factor(search, best))
    behind = {names: min(max(value - least, 0.0) / less, 1400.0) for names, value in sets.items()}
    weights = {names: math.exp(-0.5 * value) for names, value in behind.items()}
    total = sum(weights.values())
    # 3. The probability of an effect is the sum over the sets that contain it.
    shares: dict[str, float] = {}
    for names, weight in weights.items():
        for name in set(names):
            shares[name] = shares.get(name, 0.0) + weight / total
    by_name = {score.effect: score for score in search.before.screening.scores}
    order = sorted(
        by_name, key=lambda name: (-shares.get(name, 0.0), by_name[name].p_value, -by_name[name].gain)
    )
    shown = list(dict.fromkeys([*best.effects, *order]))[: max(_SHOWN, len(best.effects))]
    ranked = []
    for name in shown:
        score = by_name[name] if name in by_name else _score_beside(search, best, name)
        ranked.append(_ranked(search, best, score, min(1.0, shares.get(name, 0.0))))
    chosen = set(best.effects)
    return sorted(
        ranked, key=lambda one: (-round(one.probability, 6), one.effect not in chosen, one.delta_bic)
    )


def _factor(search: Search, best: RefittedSet) -> float:
    """Factor by which differences of mBIC are reduced: 1 if the best set leaves only noise."""
    view = search.with_discrepancies(best) if best.candidates else search.null_tests
    return 1.0 if view.adequacy.agrees else variance_factor(best.fit)


def _score_beside(search: Search, best: RefittedSet, name: str) -> Score:
    """The score, beside the others, of a member of the best set that has none in the model as given."""
    (member,) = (one for one in best.candidates if one.name == name)
    projected = search.at(best).without(member)
    columns = range(len(member.columns))
    gain = search.explained(best, member)
    indices = {one.name: k for k, one in enumerate(search.before.linearisation.candidates)}
    return Score(
        effect=name,
        candidate=indices[name],
        gain=gain,
        z=math.sqrt(gain),
        p_value=1.0,  # for the model as given
        amplitudes=best.amplitudes(member),
        kappa=float(min(projected.kappa[column] for column in columns)),
        hidden_in="",
    )


def _ranked(search: Search, best: RefittedSet, score: Score, probability: float) -> Ranked:
    name = score.effect
    trial, without = _trial_of(search, best, name)
    if trial is None or without is None:
        lin = search.before.linearisation
        candidate = lin.candidates[score.candidate]
        if trial is None:
            amplitudes = search.alone_amplitudes(name) or score.amplitudes.tolist()
            parameters = _linear_parameters(candidate, amplitudes)
        else:  # a member of the best set whose other members could not be fitted without it
            (member,) = (one for one in trial.candidates if one.name == name)
            parameters = found_parameters(trial, member)
        difference = search.price(candidate) - search.promised(score)
        drop, size = 0.0, math.sqrt(search.promised(score))
    else:
        (candidate,) = (one for one in trial.candidates if one.name == name)
        parameters = found_parameters(trial, candidate)
        difference = search.mbic(trial) - search.mbic(without)
        before, after = _nrmse(without), _nrmse(trial)
        drop = (before - after) / before if before else 0.0
        size = math.sqrt(max(without.chi2 - trial.chi2, 0.0))
    return Ranked(
        effect=name,
        probability=probability,
        score_p_value=score.p_value,
        delta_bic=difference,
        kappa=score.kappa,
        hidden_in=score.hidden_in,
        heldout_before=math.nan,
        heldout_after=math.nan,
        error_drop=drop,
        size=size,
        parameters=parameters,
    )


def _trial_of(search: Search, best: RefittedSet, name: str) -> tuple[RefittedSet | None, RefittedSet | None]:
    """The set in which an effect is judged, and that set without it: the best set if it is a member."""
    if name in best.effects:
        rest = tuple(one for one in best.effects if one != name)
        others = [t for t in search.trials.values() if tuple(sorted(t.effects)) == tuple(sorted(rest))]
        return best, (min(others, key=search.mbic) if others else search.null if not rest else None)
    for member in best.candidates if len(best.candidates) > 1 else ():
        for rival, _, _ in search.rivals(best, member):
            if name in rival.effects:
                kept = tuple(one for one in best.candidates if one is not member)
                return rival, search.known(kept)
    single = [trial for trial in search.trials.values() if trial.effects == (name,)]
    return (min(single, key=search.mbic), search.null) if single else (None, None)


def found_parameters(trial: RefittedSet, candidate: Candidate) -> dict[str, FoundParameter]:
    """An effect's fitted parameters, in the units in which they are shown."""
    parameters = {}
    fitted = {unknown.name for unknown in trial.fit.problem.shared}
    given = conditional_numbers(trial.fit)
    refined = [name for name in _shapes(candidate) if name in fitted]
    for column in (*candidate.columns, *refined):
        declared = candidate.parameter(column)
        parameters[declared.name] = FoundParameter.of(declared, *trial.reported(column), given.get(column))
    return parameters


def _shapes(candidate: Candidate) -> list[str]:
    return [qualified(candidate.name, one.name) for one in candidate.effect.parameters if one.shape]


def _linear_parameters(candidate: Candidate, amplitudes: Sequence[float]) -> dict[str, FoundParameter]:
    result = {}
    for column, amplitude in zip(candidate.columns, amplitudes, strict=True):
        declared = candidate.parameter(column)
        result[declared.name] = FoundParameter.of(declared, declared.at_null + amplitude, math.nan)
    return result


def _nrmse(trial: RefittedSet) -> float:
    errors = trial.fit.errors.values()
    count = sum(one.count for one in errors)
    return math.sqrt(sum(one.nrmse**2 * one.count for one in errors) / count) if count else 0.0


def _with_check(ranked: Ranked, check: CrossValidation | None) -> Ranked:
    return (
        ranked if check is None else replace(ranked, heldout_before=check.before, heldout_after=check.after)
    )
