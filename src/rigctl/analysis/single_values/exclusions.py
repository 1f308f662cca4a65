"""Effects excluded by a table: by themselves they cannot make the model follow the measurements.

They are judged by the trend of the misfit: the change of a quantity over an operating variable. Each effect
is fitted together with the model's own parameters, and its contribution to that change is computed without
the help of the unknowns that differ from row to row.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence

from rigctl.analysis.agreement.trends import Trend, trends
from rigctl.analysis.comparison_result import ModelComparison
from rigctl.analysis.decision_levels import LEAST_DIFFERENCE
from rigctl.analysis.diagnosis_result import Exclusion
from rigctl.analysis.search.refit_alone import Alone, at_amplitudes
from rigctl.analysis.single_values.rows import TableRow, table_rows
from rigctl.model.fit.fit import FitResult

#: an effect that makes less than this share of the missing change does not explain it
TURNS = 0.25
#: least share of the change at a single setting for it to count there
_THERE = 0.5


def main_trend(before: ModelComparison) -> Trend | None:
    """The trend with the largest relevant error of the model; None if there is none."""
    wrong = [trend for trend in before.trends if trend.matters and trend.significant]
    return wrong[0] if wrong else None


def _missed(trend: Trend) -> bool:
    """Whether the model makes less than half of a change, far too much of it, or one of the wrong sign."""
    return not 0.5 < trend.predicted / trend.measured < 1.5 if trend.measured else True


def exclusions(
    before: ModelComparison, possible: Collection[str], chi2: float, alone: Mapping[str, Alone | None]
) -> tuple[Exclusion, ...]:
    """The effects of the library that cannot explain the main misfit of a table, or do so much less well.

    None for an adequate model, for measurements over time, and if no trend is wrong.

    Parameters
    ----------
    possible: the effects that can, which are not tested.
    chi2: what the best of them leaves.
    alone: every effect of the library, fitted by itself.
    """
    trend = main_trend(before)
    if not before.rows or before.adequate or trend is None or not _missed(trend):
        return ()
    excluded = []
    for name, tried in alone.items():
        if name in possible or tried is None:
            continue
        # Excluded for one of three reasons: it hardly changes the trend; it does so only at some conditions;
        # or it fits much worse than the best. For the first, it is also tried at sizes up to the limit of its
        # range, since the fit may have stayed at a size at which it does little.
        reached = _reached(trend, tried.fit)
        only = _only(before, trend, tried.fit)
        if reached < TURNS or only or tried.chi2 - chi2 > LEAST_DIFFERENCE:
            worse = math.sqrt(max(tried.chi2 - chi2, 0.0))
            held = () if only or reached >= TURNS else at_amplitudes(before, tried, chi2)
            at_most = max([reached, *(_reached(trend, one) for one in held)])
            excluded.append(Exclusion(name, reached, only, worse, at_most))
    return tuple(sorted(excluded, key=lambda one: (bool(one.only), one.effect)))


def _reached(trend: Trend, fit: FitResult) -> float:
    """The share of the missing change that a fit makes."""
    trend_of = {(one.quantity, one.variable): one for one in trends(fit)}
    with_it = trend_of[trend.quantity, trend.variable]
    return (with_it.predicted - trend.predicted) / (trend.measured - trend.predicted)


def _only(before: ModelComparison, trend: Trend, fit: FitResult) -> tuple[str, ...]:
    """The conditions at which a fit makes half of the change, if these are some and not all."""
    had, has = _changes(before, trend, before.rows), _changes(before, trend, table_rows(fit))
    labels = [
        label
        for label, (measured, predicted) in has.items()
        if measured != had[label][1] and (predicted - had[label][1]) / (measured - had[label][1]) > _THERE
    ]
    return tuple(labels) if 0 < len(labels) <= len(has) // 2 else ()


def _changes(
    before: ModelComparison, trend: Trend, rows: Sequence[TableRow]
) -> dict[str, tuple[float, float]]:
    """(measured, predicted) change from the low to the high end of the variable, for each other condition."""
    records = before.fit.problem.records
    groups: dict[str, list[tuple[float, TableRow]]] = {}
    for row in rows:
        condition = records[row.record].condition
        at = condition.get(trend.variable)
        if at is None or row.quantity != trend.quantity:
            continue
        others = [value for name, value in condition.items() if name != trend.variable]
        shown = row.condition.split(", ")
        index = list(condition).index(trend.variable)
        label = ", ".join(text for k, text in enumerate(shown) if k != index) if others else ""
        groups.setdefault(label, []).append((at, row))
    changes = {}
    for label, members in groups.items():
        low, high = min(members, key=lambda one: one[0])[1], max(members, key=lambda one: one[0])[1]
        changes[label] = (high.measured - low.measured, high.predicted - low.predicted)
    return changes
