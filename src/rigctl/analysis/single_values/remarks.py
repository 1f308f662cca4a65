"""What a diagnosis of a table reports besides its verdict: what is excluded, and what to measure next."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from rigctl.analysis.comparison_result import ModelComparison
from rigctl.analysis.conclusion import OneOfTable
from rigctl.analysis.diagnosis_result import Exclusion, Ranked, Verdict
from rigctl.analysis.linear.candidates import Candidate
from rigctl.analysis.search.refit import RefittedSet
from rigctl.analysis.search.refit_alone import Alone
from rigctl.analysis.search.rivals import Rival, classes_of
from rigctl.analysis.single_values.exclusions import exclusions, main_trend
from rigctl.analysis.single_values.next_values import (
    NextStep,
    next_against_chance,
    next_channels,
    next_rows,
)


@dataclass(frozen=True)
class TableRemarks:
    """What accompanies a verdict on a table; nothing for measurements over time.

    Attributes
    ----------
    conclusion: replaces the usual one; None to keep that.
    excluded: effects that alone cannot explain it.
    next_steps: what to measure next.
    """

    conclusion: OneOfTable | None = None
    excluded: tuple[Exclusion, ...] = ()
    next_steps: tuple[NextStep, ...] = ()


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
        conclusion=_ambiguous(before, best, rivals, ranking) if verdict is Verdict.AMBIGUOUS else None,
        excluded=excluded,
        next_steps=(*next_channels(before, trend, members), *next_rows(before)),
    )


def _ambiguous(
    before: ModelComparison, best: RefittedSet, rivals: Sequence[Rival], ranking: Sequence[Ranked]
) -> OneOfTable | None:
    """All effects that explain a table; None if it is not a matter of single effects."""
    close = [rival for rival in rivals if not rival.separable]
    if len(best.candidates) != 1 or not close:
        return None
    fitted = {one.effect: one.parameters for one in ranking}
    chosen = [*best.candidates, *(_candidate(rival) for rival in close)]
    return OneOfTable(tuple((one.effect, fitted.get(one.name)) for one in chosen), len(before.rows))


def _candidate(rival: Rival) -> Candidate:
    return {one.name: one for one in rival.trial.candidates}[rival.name]
