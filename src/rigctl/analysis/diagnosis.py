"""Which physical effect is missing from a model, how certain that is, and with what it may be confused.

In: a comparison of the model (`ModelComparison`), with the equations of the whole library. Out: a
`Diagnosis`. The search proposes a set of effects and judgement decides on it: the first only minimises a
criterion, so that it has an answer even where nothing should be named. What is measured wrongly is tried
before what is missing (`_searched_with_sensors`), and a search is repeated if what it finds shows that the
noise or the fit it began with was wrong (`_searched`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace

from rigctl.analysis.agreement.undecided import Decision, WiderBounds, what_decides
from rigctl.analysis.agreement.untestable import untestable
from rigctl.analysis.beyond_bounds import agreeing_beyond, values_beyond
from rigctl.analysis.collected_evidence import collected_evidence, drift_evidence
from rigctl.analysis.comparison import compare
from rigctl.analysis.comparison_result import ModelComparison
from rigctl.analysis.conclusion import (
    AsCompared,
    Conclusion,
    Doubt,
    MostlyWithinTolerance,
    NotProven,
    Outcome,
    WithinTolerance,
    conclude,
    whether_at_all,
)
from rigctl.analysis.diagnosis_result import Diagnosis, Drift, Ranked, Verdict
from rigctl.analysis.evidence import Evidence, IfExact
from rigctl.analysis.fitting import OnProgress, no_progress, require_free_parameters
from rigctl.analysis.laws.answer import LawAnswer, laws_instead
from rigctl.analysis.linear.candidates import Candidate
from rigctl.analysis.search.judgement import Judgement, agrees_within_tolerance, judge_set
from rigctl.analysis.search.ranking import most_visible, ranking_of
from rigctl.analysis.search.refit import RefittedSet, plain
from rigctl.analysis.search.repeated_fit import from_another_start, in_scale_of
from rigctl.analysis.search.search import Search, require_number_of_effects
from rigctl.analysis.single_values.remarks import table_remarks
from rigctl.argument_types import checks_argument_types
from rigctl.dataset.run import Run
from rigctl.engine.one_thread import one_thread
from rigctl.model.measured.note import Note
from rigctl.model.model import Model
from rigctl.model.validity import departures
from rigctl.units import parse_unit

_SHOWN = 12
#: how often the scale of the errors may be reduced to what the nearest set leaves
_SCALES = 3
#: what each verdict that something is missing concludes of the best set
_OUTCOMES: Mapping[Verdict, Outcome] = {
    Verdict.MISSING_EFFECT: "missing",
    Verdict.AMBIGUOUS: "ambiguous",
    Verdict.OUTSIDE_LIBRARY: "outside",
}
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
        as `rigctl.analysis.comparison.compare`; the model has no free parameters; or `most` is less than one.
    """
    require_number_of_effects(most)
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
    notes: Sequence[Note] = (),
    *,
    most: int = 2,
    further_laws: Callable[[Diagnosis], bool] = lambda _: True,
    on_progress: OnProgress | None = None,
) -> Diagnosis:
    """Diagnose a model that has been compared with data.

    `further_laws` is called with the diagnosis, and says whether the laws of the effects that the model has
    are to be estimated too, on which nothing else in it depends; those of the named effects always are.

    Raises
    ------
    RigctlError
        `most` is less than one, or the model cannot be simulated at its fit.
    """
    require_number_of_effects(most)
    # a bound that a user wrote comes first: an effect would only imitate what the bound forbids
    beyond = agreeing_beyond(before)
    if beyond is not None:
        return _undecided_by_bound(before, beyond, runs, held_out, notes)
    # The search minimises a criterion, and has an answer even where nothing is missing. Whether that answer
    # may be named, and how much of it is certain, is decided by the judgement alone.
    search, found, if_exact = _searched_with_sensors(before, most, on_progress or no_progress)
    judgement = judge_set(search, found)
    best, verdict = judgement.best, judgement.verdict
    # where nothing is named, the answer is that of the comparison, in the scale of its own errors
    before = judgement.shown
    ranking = ranking_of(search, best, judgement.checks)
    remarks = table_remarks(before, best, judgement.rivals, verdict, ranking, search.alone)
    sensor = before.adequacy.only_misread
    undecided = (verdict is Verdict.OUTSIDE_LIBRARY and not sensor) or before.adequacy.below_noise
    doubt = whether_at_all(before) if undecided else None
    drift = _drift(before, best)
    # Where errors of sensors are in the fit, the same diagnosis without them shows what they cover up.
    exact = _with_exact_sensors(before, most, on_progress)
    diagnosis = Diagnosis(
        runs=tuple(runs),
        model=before.name,
        verdict=verdict,
        effects=best.effects if judgement.named else (),
        classes=judgement.classes,
        indistinguishable=tuple((rival.member, rival.name) for rival in judgement.close),
        ranking=tuple(ranking),
        untestable=tuple(untestable(before)),
        drift=tuple(drift),
        conclusion=remarks.conclusion or _conclusion(judgement, ranking),
        evidence=(
            *collected_evidence(judgement, {member.name: one for member, one in _members(best, ranking)}),
            *_with_exact(before, exact),
            *([] if if_exact is None else [if_exact]),
            *drift_evidence(drift),
        ),
        held_out=tuple(held_out),
        notes=tuple(notes),
        before=before,
        best=best,
        trials=tuple(search.trials.values()),
        excluded=remarks.excluded,
        next_steps=remarks.next_steps,
        p_value_after=(search.at(best) if best.candidates else before).adequacy.p_value,
        unproven_after=_unproven_after(search, best),
        remainder=judgement.remaining,
        doubt=doubt,
        levels=judgement.levels,
        laws=judgement.laws,
        outside=departures(best.fit),
        unconfirmed=judgement.unconfirmed,
        decided_by=_decided_by(before, verdict),
        with_exact_sensors=exact,
        if_exact=if_exact,
    )
    if not further_laws(diagnosis):
        return diagnosis
    outside = judgement.of_set is Verdict.OUTSIDE_LIBRARY
    return replace(diagnosis, laws=_laws_instead(search) if outside else judgement.every_law.of())


def _answered(search: Search, found: RefittedSet, inexact: ModelComparison) -> bool:
    """Whether a search with exact sensors is the answer. A set that leaves nothing, but cannot be named for
    want of proof, is not, where errors of sensors larger than stated explain the same."""
    if not _explained(search, found):
        return False
    unproven = found.candidates and inexact.adequacy.only_misread and not judge_set(search, found).named
    return not unproven


def _explained(search: Search, found: RefittedSet) -> bool:
    """Whether nothing is left, with what was found or within the tolerance of the model's own laws."""
    return agrees_within_tolerance(search) or search.at(found).adequacy.agrees


def _unproven_after(search: Search, best: RefittedSet) -> tuple[str, ...]:
    """The channels of which the errors with a set are not shown to be noise."""
    if not best.candidates or search.with_discrepancies(best).adequacy.agrees:
        return ()
    return search.at(best).adequacy.unproven


def _undecided_by_bound(
    before: ModelComparison,
    beyond: ModelComparison,
    runs: Sequence[str],
    held_out: Sequence[str],
    notes: Sequence[Note],
) -> Diagnosis:
    """The diagnosis of a model that agrees beyond a bound that a user wrote: no effect is looked for."""
    return Diagnosis(
        runs=tuple(runs),
        model=before.name,
        verdict=Verdict.UNDECIDED,
        effects=(),
        classes=(),
        indistinguishable=(),
        ranking=(),
        untestable=tuple(untestable(before)),
        drift=(),
        conclusion=AsCompared(),
        evidence=(),
        held_out=tuple(held_out),
        notes=tuple(notes),
        before=before,
        best=plain(before.fit),
        trials=(),
        p_value_after=before.adequacy.p_value,
        doubt=Doubt("beyond_bounds", values=values_beyond(before, beyond)),
        decided_by=(WiderBounds(tuple(one.parameter for one in before.bounds if one.decisive)),),
    )


def _decided_by(before: ModelComparison, verdict: Verdict) -> tuple[Decision, ...]:
    """What would decide what is open: slow noise or an effect, a sensor or an effect."""
    if before.adequacy.unusable:
        return ()
    if verdict is Verdict.UNDECIDED:
        return what_decides(before.fit, before.adequacy.unproven)
    return before.decided_by if before.explained_by else ()


def _with_exact_sensors(
    before: ModelComparison, most: int, on_progress: OnProgress | None
) -> Diagnosis | None:
    """What would be missing if no sensor could be wrong; None where that makes no difference."""
    if before.exact is None:
        return None
    return diagnose_comparison(before.exact, most=most, further_laws=lambda _: False, on_progress=on_progress)


def _with_exact(before: ModelComparison, exact: Diagnosis | None) -> list[Evidence]:
    """The verdict that exact sensors would have."""
    if exact is None or before.sensors is None:
        return []
    return [Evidence("", exact.effects, "exact_sensors", finding=IfExact(before.sensors, exact))]


def _conclusion(judgement: Judgement, ranking: Sequence[Ranked]) -> Conclusion:
    """The conclusion: that of the comparison, of the laws' tolerance, or of the best set."""
    search, best, verdict = judgement.search, judgement.best, judgement.verdict
    if verdict is Verdict.OUTSIDE_LIBRARY and judgement.shown.adequacy.only_misread:
        return AsCompared()
    tolerated = None if search.in_own_scale else _tolerated(search, best)
    if tolerated is not None:
        return tolerated
    if search.in_own_scale and verdict is Verdict.OUTSIDE_LIBRARY:
        return NotProven()
    if verdict in (Verdict.ADEQUATE, Verdict.UNDECIDED):
        return AsCompared()
    return conclude(
        _OUTCOMES[verdict],
        _members(best, ranking),
        judgement.rivals,
        judgement.remaining,
        judgement.checks,
        most_visible(search, ranking) if not best.candidates else None,
        (*judgement.edges, *judgement.against, *judgement.undriven),
        search.allowed,
    )


def _members(best: RefittedSet, ranking: Sequence[Ranked]) -> list[tuple[Candidate, Ranked]]:
    """The members of a set with their places in the ranking."""
    by_name = {one.effect: one for one in ranking}
    return [(candidate, by_name[candidate.name]) for candidate in best.candidates]


def _laws_instead(search: Search) -> tuple[LawAnswer, ...]:
    """If something is missing and nothing is named, the law of an effect already in the model may be at
    fault: such a law is reported only if it removes nearly all of the misfit."""
    return laws_instead(search) if search.null.fit.problem.model.with_laws else ()


def _searched_with_sensors(
    before: ModelComparison, most: int, on_progress: OnProgress
) -> tuple[Search, RefittedSet, Evidence | None]:
    """The search that is answered, its best set, and what exact sensors would show if that is something else.

    Where only an uncertainty of sensors is stated, they are exact at first. If no effects then explain what
    is left, errors of sensors are a part of the answer: alone, larger than stated, or within it beside an
    effect, which with exact sensors may have been taken for another.
    """
    search, found = _searched(before, most, on_progress)
    # Exact sensors first: a model that lacks something pulls its sensors beyond what is stated, so that with
    # a free zero, gain and curvature of each the search would find less.
    inexact = before.with_sensor_errors
    if inexact is None or inexact.adequacy.unproven or _answered(search, found, inexact):
        return search, found, None
    if inexact.adequacy.only_misread or search.left(found):
        beside, best = _searched(inexact, most, on_progress)
        within = not beside.at(best).adequacy.misread
        if agrees_within_tolerance(beside):
            return beside, best, None
        if within and search.left(found) and not beside.left(best):
            return beside, best, None if found.effects == best.effects else _nearest(search, found)
    return search, found, None


def _nearest(search: Search, found: RefittedSet) -> Evidence:
    """What a search with exact sensors found, which leaves something."""
    return Evidence("", found.effects, "left_with_exact_sensors", search.left(found))


def _searched(before: ModelComparison, most: int, on_progress: OnProgress) -> tuple[Search, RefittedSet]:
    """The search and its best set; repeated if the refits show that the noise or the fit was wrong."""

    def begun(compared: ModelComparison) -> Search:
        return Search(compared, compared.whole, most=most, on_progress=on_progress, given=before)

    def ended(search: Search) -> RefittedSet:
        return search.null if agrees_within_tolerance(search) else search.best()

    # Where only the floor of the noise is known, the scale of the errors is what a model leaves, and
    # everything that the search compares depends on it. It begins with what the model itself leaves, every
    # reading counted as independent, or an effect would seem to explain nothing; then the nearest set gives
    # the scale (larger or smaller the first time, only smaller afterwards), until it hardly changes.
    search = begun(before)
    scaled = search.in_own_scale and not agrees_within_tolerance(search)
    if scaled:
        again = in_scale_of(search, search.null, independent=True)
        search = search if again is None else begun(again)
    for turn in range(_SCALES if scaled else 0):
        # in the scale of what the nearest set leaves another one may be nearer, and leave less
        again = in_scale_of(search, search.nearest(), larger=turn == 0)
        if again is None:
            break
        search = begun(again)
    best = ended(search)
    # A refit may have found a deeper minimum of the given model, with an effect of hardly any size. Then all
    # differences of χ² were taken from the wrong minimum, and the search starts anew from the right one.
    again = from_another_start(search)
    if again is not None:
        search = begun(again)
        best = ended(search)
    return search, best


def _tolerated(search: Search, best: RefittedSet) -> WithinTolerance | MostlyWithinTolerance | None:
    """That the misfit, or most of it, is within the shape tolerance of the model's effects; None if not."""
    laws = tuple(search.before.fit.problem.model.with_laws)
    if agrees_within_tolerance(search):
        return None if search.before.adequate else WithinTolerance(laws, search.before.adequacy.p_value)
    if best.candidates or not search.has_discrepancies:
        return None
    paying = [one for one in search.trials.values() if search.mbic(one) < search.mbic(search.null)]
    if not paying:
        return None
    nearest = min(paying, key=search.mbic)
    explained = search.null.chi2 - nearest.chi2
    beyond = max(search.evidence(search.null) - search.evidence(nearest), 0.0) / explained
    return MostlyWithinTolerance(laws, nearest.effects, beyond)


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
        stds = (one.reported_std.get(unknown.name, math.nan) / unit.factor for one in (before.fit, best.fit))
        drifts.append(Drift(unknown.name, *ends, declared.unit, *stds))
    return drifts
