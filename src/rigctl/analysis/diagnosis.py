"""Which physical effect is missing from a model, how certain that is, and with what it may be confused."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace

import numpy as np

from rigctl.analysis.adequacy import chance_text, variance_factor
from rigctl.analysis.candidates import Candidate
from rigctl.analysis.certainty import (
    Answer,
    certain_levels,
    cross_validations,
    evidence_against,
    size_scatters,
)
from rigctl.analysis.comparison import compare
from rigctl.analysis.comparison_result import ModelComparison
from rigctl.analysis.cross_validation import CrossValidation
from rigctl.analysis.decision_levels import ALPHA, SHAPE_TOLERANCE, SLIGHT
from rigctl.analysis.diagnosis_result import Diagnosis, Drift, FoundParameter, Ranked, Verdict
from rigctl.analysis.fitting import OnProgress, no_progress, require_free_parameters
from rigctl.analysis.identity import same_cause
from rigctl.analysis.laws.answer import LawAnswer, Laws, laws_instead
from rigctl.analysis.linearisation import slopes_at
from rigctl.analysis.power import hidden_at_typical_size, power_text
from rigctl.analysis.refit import RefittedSet
from rigctl.analysis.remainder import Remainder, remainder, share_text
from rigctl.analysis.repeated_fit import from_another_start, in_noise_of_the_leader
from rigctl.analysis.rivals import Rival, classes_of, find_rivals
from rigctl.analysis.score_test import Score
from rigctl.analysis.search import Search
from rigctl.analysis.separability import softened
from rigctl.analysis.single_values.remarks import table_remarks
from rigctl.analysis.text import (
    drift_text,
    evidence_for,
    failed_checks,
    verdict_text,
    whether_at_all,
)
from rigctl.argument_types import checks_argument_types
from rigctl.dataset.run import Run
from rigctl.effects.declaration import qualified
from rigctl.effects.record_level import RECORD
from rigctl.engine.one_thread import one_thread
from rigctl.model.model import Model
from rigctl.model.validity import departures
from rigctl.units import parse_unit

_SHOWN = 12
#: share of an effect's signature that unrecorded inputs can reproduce, above which they hide it
_MOSTLY = 0.5


@checks_argument_types
def diagnose(
    runs: Sequence[Run],
    model: Model,
    *,
    hold_out: str | None = None,
    only: str | None = None,
    most: int = 2,
    excluded: Collection[str] = (),
    on_progress: OnProgress | None = None,
) -> Diagnosis:
    """Diagnose a model on the usable records of `runs`; see `Diagnosis`.

    Parameters
    ----------
    hold_out: a condition that selects the records to be held out; nothing here sees them.
    only: a condition that selects the records to be used.
    most: number of effects in the largest set that is tried: one or two.
    excluded: effects of the library that are not to be considered.

    Raises
    ------
    RigctlError
        as `rigctl.analysis.comparison.compare`; or the model has no free parameters.
    """
    require_free_parameters(model)
    compared = compare(
        runs, [model], hold_out=hold_out, only=only, excluded=excluded, on_progress=on_progress
    )
    return diagnose_comparison(
        compared.models[0],
        compared.runs,
        compared.held_out,
        compared.notes,
        most=most,
        on_progress=on_progress,
    )


@one_thread()
def diagnose_comparison(
    before: ModelComparison,
    runs: Sequence[str] = (),
    held_out: Sequence[str] = (),
    notes: Sequence[str] = (),
    *,
    most: int = 2,
    further_laws: Callable[[Diagnosis], bool] = lambda _: True,
    on_progress: OnProgress | None = None,
) -> Diagnosis:
    """Diagnose a model that has been compared with data.

    `further_laws` is called with the diagnosis, and says whether the laws of the effects that the model has
    are to be estimated too, on which nothing else in it depends; those of the named effects always are.
    """
    search, best = _searched(before, most, on_progress or no_progress)
    before = search.before
    best, rivals = _sure_members(search, best)
    close = [rival for rival in rivals if not rival.separable]
    checks = cross_validations(search, best)
    remaining = remainder(search, best)
    ranking = [_with_check(one, checks.get(one.effect)) for one in _ranking(search, best)]
    verdict = _verdict(search, best, close, checks, remaining)
    outside, every_law = verdict is Verdict.OUTSIDE_LIBRARY, Laws(search, best)
    laws = () if outside else every_law.of(best.effects)
    against = evidence_against(search, best, checks, remaining)
    scatters = size_scatters(search, best)
    undriven = [law.statement for law in laws if law.constant and law.effect in best.effects]
    undriven += [one.statement for one in scatters if one.follows]
    if undriven and verdict is Verdict.MISSING_EFFECT:
        verdict = Verdict.AMBIGUOUS
    by_name = {one.effect: one for one in ranking}
    chosen = [(candidate, by_name[candidate.name]) for candidate in best.candidates]
    drift = _drift(before, best)
    evidence: list[str] = power_text(before.projected) if before.adequacy.agrees else []
    evidence += [quantity.statement for quantity in before.record_level if quantity.statement]
    for candidate, ranked in chosen:
        evidence += evidence_for(candidate, ranked, checks[candidate.name], rivals)
    remarks = table_remarks(before, best, rivals, verdict, ranking, search.alone)
    undecided = verdict is Verdict.OUTSIDE_LIBRARY or before.adequacy.below_noise
    doubt = whether_at_all(before) if undecided else ""
    visible = _most_visible(search, ranking) if not best.candidates else None
    after = search.at(best) if best.candidates else None
    named = verdict in (Verdict.MISSING_EFFECT, Verdict.AMBIGUOUS)
    only_unpredicted = named and not close and not undriven and len(against) == 1
    classes = classes_of(best, rivals) if named else ()
    answer = Answer(search, best, classes, checks, remaining)
    levels = certain_levels(answer, laws, scatters) if named else ()
    evidence += [*answer.alone_text(levels), *(one.statement for one in levels if one.statement)]
    against = answer.against(answer.certain_alone(levels))
    evidence += [one.statement for one in scatters if named and one.statement and not one.follows]
    diagnosis = Diagnosis(
        runs=tuple(runs),
        model=before.name,
        verdict=verdict,
        effects=best.effects if named else (),
        classes=classes,
        indistinguishable=tuple((rival.member, rival.name) for rival in close),
        ranking=tuple(ranking),
        untestable=tuple(_untestable(before)),
        drift=tuple(drift),
        statement=remarks.statement
        or _shape_alone(search)
        or _shape_mostly(search, best)
        or verdict_text(
            verdict,
            before,
            chosen,
            rivals,
            remaining,
            checks,
            visible,
            [*against, *undriven],
            doubt,
            search.allowed,
        ),
        evidence=(*evidence, *drift_text(drift)),
        held_out=tuple(held_out),
        notes=tuple(notes),
        before=before,
        best=best,
        trials=tuple(search.trials.values()),
        excluded=remarks.excluded,
        excluded_because=remarks.why,
        next_steps=remarks.next_steps,
        p_value_after=before.adequacy.p_value if after is None else after.adequacy.p_value,
        remainder=remaining,
        doubt=doubt,
        levels=levels,
        laws=laws,
        outside=departures(best.fit),
        unconfirmed=failed_checks(checks) if only_unpredicted else (),
    )
    if not further_laws(diagnosis):
        return diagnosis
    return replace(diagnosis, laws=_laws_instead(search) if outside else every_law.of())


def _laws_instead(search: Search) -> tuple[LawAnswer, ...]:
    """If something is missing and nothing is named, the law of an effect already in the model may be at
    fault: such a law is reported only if it removes nearly all of the misfit."""
    return laws_instead(search) if search.none.fit.problem.model.with_laws else ()


def _searched(before: ModelComparison, most: int, on_progress: OnProgress) -> tuple[Search, RefittedSet]:
    """The search and its best set; repeated if the refits show that the noise or the fit was wrong."""
    search = Search(before, before.whole, most=most, on_progress=on_progress)
    again = in_noise_of_the_leader(search)
    if again is not None:
        search = Search(again, again.whole, most=most, on_progress=on_progress)
    best = search.none if _agrees_within_tolerance(search) else search.best()
    again = from_another_start(search)
    if again is not None:
        search = Search(again, again.whole, most=most, on_progress=on_progress)
        best = search.none if _agrees_within_tolerance(search) else search.best()
    return search, best


def _agrees_within_tolerance(search: Search) -> bool:
    """Whether the model agrees with the data, within the shape tolerance of its effects' laws."""
    return search.before.adequate or search.start.adequacy.adequate


def _sure_members(search: Search, best: RefittedSet) -> tuple[RefittedSet, list[Rival]]:
    """The best set and its rivals, without a small member that cannot be distinguished from other effects.

    What little such a member explains beside the rest is then part of the remainder, and reported as such,
    because its identity is uncertain. Laws of one cause do not count as other effects. The member stays if
    the tests find nothing left with it: then something is missing beside the other member, and its class
    lists the possible effects.
    """
    rivals = find_rivals(search, best)
    if len(best.candidates) < 2 or not search.excess(best):
        return best, rivals
    reached = search.none.chi2 - best.chi2
    for member in best.candidates:
        close = any(
            rival.member == member.name
            and not rival.separable
            and not same_cause(member.effect, search.effect(rival.name))
            for rival in rivals
        )
        rest = search.known([one for one in best.candidates if one is not member])
        if close and rest is not None and search.explained(best, member) < SLIGHT * reached:
            return rest, find_rivals(search, rest)
    return best, rivals


def _verdict(
    search: Search,
    best: RefittedSet,
    close: Sequence[Rival],
    checks: dict[str, CrossValidation | None],
    remaining: Remainder | None,
) -> Verdict:
    if _agrees_within_tolerance(search):
        return Verdict.ADEQUATE
    if not best.candidates or not search.sure(best):
        return Verdict.OUTSIDE_LIBRARY
    if failed_checks(checks) and remaining is not None and len(best.candidates) > 1:
        # several effects that neither explain all of the misfit nor predict records left out of their fit
        # together imitate one that is not in the library
        return Verdict.OUTSIDE_LIBRARY
    if close or evidence_against(search, best, checks, remaining):
        return Verdict.AMBIGUOUS
    return Verdict.MISSING_EFFECT


def _shape_alone(search: Search) -> str:
    """The sentence that the misfit is within the shape tolerance of the model's effects; "" if not."""
    if search.before.adequate or not _agrees_within_tolerance(search):
        return ""
    return (
        "Nothing more is missing that these data show: the model does not agree with the measurements "
        f"({chance_text(search.before.adequacy.p_value)}), but what is left is within "
        f"{share_text(SHAPE_TOLERANCE)} of the law of {_laws_of(search)}, which the bench need not follow "
        "exactly"
    )


def _shape_mostly(search: Search, best: RefittedSet) -> str:
    """The sentence that a further effect explains little beyond the model's shape tolerance; else ""."""
    if best.candidates or not search.bends_model or _agrees_within_tolerance(search):
        return ""
    paying = [one for one in search.trials.values() if search.mbic(one) < search.mbic(search.none)]
    if not paying:
        return ""
    nearest = min(paying, key=search.mbic)
    explained = search.none.chi2 - nearest.chi2
    beyond = max(search.evidence(search.none) - search.evidence(nearest), 0.0) / explained
    return (
        "Something is missing, but these data do not show what. Most of it is within "
        f"{share_text(SHAPE_TOLERANCE)} of the law of {_laws_of(search)}, which the bench need not follow "
        f"exactly; not all of it is. The nearest in the library is {' and '.join(nearest.effects)}, but only "
        f"{share_text(beyond)} of what that explains is more than such deviations explain"
    )


def _laws_of(search: Search) -> str:
    """The effects already in the model, in words."""
    return " and ".join(search.before.fit.problem.model.with_laws)


def _most_visible(search: Search, ranking: Sequence[Ranked]) -> Ranked | None:
    """The refitted effect with the lowest mBIC, where only the score test rejects and no set lowers mBIC.

    None if another test rejects as well: no effect has explained what that test sees.
    """
    tests = search.before.adequacy.tests
    rejecting = {name for name, test in tests.items() if len(tests) * test.p_value < ALPHA}
    refitted = {trial.effects[0] for trial in search.trials.values() if len(trial.effects) == 1}
    tried = [one for one in ranking if one.effect in refitted and one.size > 0.0]
    return min(tried, key=lambda one: one.delta_bic, default=None) if rejecting == {"score"} else None


def _ranking(search: Search, best: RefittedSet) -> list[Ranked]:
    """Effects with their probabilities over all sets that were tried, the empty set among them."""
    trials = [search.none, *search.trials.values()]
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
        sets[(score.effect,)] = search.mbic(search.none) - search.promised(score) + price
    # a set better than the best one is so by less than the shape tolerance allows, or it would be the best
    least = search.mbic(best)
    less = max(softened(search.none.chi2 - best.chi2), _factor(search, best))
    behind = {names: min(max(value - least, 0.0) / less, 1400.0) for names, value in sets.items()}
    weights = {names: math.exp(-0.5 * value) for names, value in behind.items()}
    total = sum(weights.values())
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
    view = search.bent(best) if best.candidates else search.start
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
        return best, (min(others, key=search.mbic) if others else search.none if not rest else None)
    for member in best.candidates if len(best.candidates) > 1 else ():
        for rival, _, _ in search.rivals(best, member):
            if name in rival.effects:
                kept = tuple(one for one in best.candidates if one is not member)
                return rival, search.known(kept)
    single = [trial for trial in search.trials.values() if trial.effects == (name,)]
    return (min(single, key=search.mbic), search.none) if single else (None, None)


def found_parameters(trial: RefittedSet, candidate: Candidate) -> dict[str, FoundParameter]:
    """An effect's fitted parameters, in the units in which they are shown."""
    parameters = {}
    fitted = {unknown.name for unknown in trial.fit.problem.shared}
    refined = [name for name in _shapes(candidate) if name in fitted]
    for column in (*candidate.columns, *refined):
        declared = candidate.parameter(column)
        parameters[declared.name] = FoundParameter.of(declared, *trial.value(column))
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


def _untestable(before: ModelComparison) -> list[tuple[str, str]]:
    """Effects whose signature these data do not show, and what would make it visible."""
    by_name = {one.name: one.effect for one in before.linearisation.candidates}
    measured = set(before.fit.problem.measurements.outputs)
    reasons = []
    for name in before.screening.untestable:
        effect = by_name[name]
        sensors = [slot.removesuffix("_reading") for slot in effect.slots if slot.endswith("_reading")]
        absent = [sensor for sensor in sensors if sensor not in measured]
        needs = (
            f"the channel {', '.join(absent)}" if absent else effect.needs or "other commands or conditions"
        )
        reasons.append((name, needs))
    return reasons + _hidden_by_unrecorded(before)


def _hidden_by_unrecorded(before: ModelComparison) -> list[tuple[str, str]]:
    """Effects not detectable at their typical size because an unrecorded input can imitate most of them."""
    fit, lin = before.fit, before.linearisation
    inputs = sorted({name for record in fit.problem.records for name in record.unrecorded})
    small = set(hidden_at_typical_size(before.projected)) if inputs else set()
    suspects = [one for one in before.screening.scores if one.effect in small and one.hidden_in == RECORD]
    if not suspects:
        return []
    inner = before.whole.only(fit.fitted)
    chosen = [lin.candidates[one.candidate] for one in suspects]
    count = sum(len(one.columns) for one in chosen) + len(inner.local_names) + len(inner.initial_names)
    ends = np.cumsum([len(one.columns) for one in chosen])[:-1]
    total, absorbed = np.zeros(len(chosen)), np.zeros(len(chosen))
    for part in inner.parts(count):
        some = inner.only(part)
        slopes = slopes_at(some, fit, (), chosen, [fit.local[fit.fitted[k]] for k in part])
        for k, whitener in enumerate(some.whiteners):
            names = [qualified(RECORD, name) for name in some.records[k].unrecorded]
            white = whitener(slopes.signatures[k])
            basis = np.empty((len(white), 0))
            if names:
                of_inputs = np.stack([slopes.record_local[k][name] for name in names], axis=2)
                basis = np.linalg.qr(whitener(of_inputs))[0]
            for index, columns in enumerate(np.split(white, ends, axis=1)):
                total[index] += float(np.square(columns).sum())
                absorbed[index] += float(np.square(basis.T @ columns).sum())
    needed = " and ".join(inputs)
    needs = f"a record of {needed}: unrecorded, {'it' if len(inputs) == 1 else 'they'} can do nearly the same"
    return [
        (one.effect, needs)
        for one, share, all_of_it in zip(suspects, absorbed, total, strict=True)
        if all_of_it > 0.0 and share > _MOSTLY * all_of_it
    ]


def _drift(before: ModelComparison, best: RefittedSet) -> list[Drift]:
    if not best.candidates:
        return []
    family = before.fit.problem.model.family
    after = dict(zip([u.name for u in best.fit.problem.shared], best.fit.values.tolist(), strict=True))
    drifts = []
    for unknown, value in zip(before.fit.problem.shared, before.fit.values.tolist(), strict=True):
        if "." in unknown.name:
            continue
        declared = family.parameter(unknown.name)
        unit = parse_unit(declared.unit)
        ends = unit.from_si(value), unit.from_si(after.get(unknown.name, value))
        stds = (one.std.get(unknown.name, math.nan) / unit.factor for one in (before.fit, best.fit))
        drifts.append(Drift(unknown.name, *ends, declared.unit, *stds))
    return drifts
