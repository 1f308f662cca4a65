"""What a diagnosis of a table reports besides its verdict: what is excluded, and what to measure next."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from rigctl.analysis.comparison_result import ModelComparison
from rigctl.analysis.diagnosis_result import Exclusion, Ranked, Verdict
from rigctl.analysis.linear.candidates import Candidate
from rigctl.analysis.search.refit import RefittedSet
from rigctl.analysis.search.refit_alone import Alone
from rigctl.analysis.search.rivals import Rival, classes_of
from rigctl.analysis.single_values.exclusions import exclusion_text, exclusions, main_trend
from rigctl.analysis.single_values.next_values import next_against_chance, next_channels, next_rows
from rigctl.analysis.text import parameters_text


@dataclass(frozen=True)
class TableRemarks:
    """Sentences that accompany a verdict on a table; none for measurements over time.

    Attributes
    ----------
    statement: replaces the usual one; "" to keep that.
    excluded: effects that alone cannot explain it; `why` a sentence for each reason.
    next_steps: what to measure next.
    """

    statement: str = ""
    excluded: tuple[Exclusion, ...] = ()
    why: tuple[str, ...] = ()
    next_steps: tuple[str, ...] = ()


def table_remarks(
    before: ModelComparison,
    best: RefittedSet,
    rivals: Sequence[Rival],
    verdict: Verdict,
    ranking: Sequence[Ranked],
    alone: Mapping[str, Alone | None],
) -> TableRemarks:
    """The remarks on a verdict; `alone` are the effects fitted by themselves."""
    if not before.rows:
        return TableRemarks()
    if verdict is Verdict.ADEQUATE:
        return TableRemarks(
            next_steps=tuple(dict.fromkeys([*next_against_chance(before), *next_rows(before)]))
        )
    trend = main_trend(before)
    classes = classes_of(best, rivals)
    possible = {name for names in classes for name in names}
    single = len(best.candidates) <= 1
    excluded = exclusions(before, possible, best.chi2, alone) if single else ()
    members = dict.fromkeys(best.effects[:1], best.fit)
    members |= {rival.name: rival.trial.fit for rival in rivals if not rival.separable}
    return TableRemarks(
        statement=_ambiguous(before, best, rivals, ranking) if verdict is Verdict.AMBIGUOUS else "",
        excluded=excluded,
        why=tuple(exclusion_text(excluded, trend)) if trend is not None else (),
        next_steps=(*next_channels(before, trend, members), *next_rows(before)),
    )


def _ambiguous(
    before: ModelComparison, best: RefittedSet, rivals: Sequence[Rival], ranking: Sequence[Ranked]
) -> str:
    """All effects that explain a table, in one sentence each; "" if not a matter of single effects."""
    close = [rival for rival in rivals if not rival.separable]
    if len(best.candidates) != 1 or not close:
        return ""
    by_name = {one.effect: one for one in ranking}
    chosen = [*best.candidates, *(_candidate(rival) for rival in close)]
    explanations = "; ".join(
        f"{one.effect.summary.rstrip('.')} ({one.name}"
        + (f", {parameters_text(by_name[one.name].parameters)})" if one.name in by_name else ")")
        for one in chosen
    )
    count = f"{len(before.rows)} values"
    return (
        f"Something is missing, and these {count} cannot tell which of {len(chosen)} effects it is: "
        f"{explanations}"
    )


def _candidate(rival: Rival) -> Candidate:
    return {one.name: one for one in rival.trial.candidates}[rival.name]
