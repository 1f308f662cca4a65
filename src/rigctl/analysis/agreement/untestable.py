"""Effects that these data cannot test, and what would make them testable."""

from __future__ import annotations

import numpy as np

from rigctl.analysis.comparison_result import ModelComparison
from rigctl.analysis.linear.power import hidden_at_typical_size
from rigctl.analysis.linear.slopes import slopes_at
from rigctl.effects.declaration import qualified
from rigctl.effects.record_level import RECORD

#: share of an effect's signature that unrecorded inputs can reproduce, above which they hide it
_MOSTLY = 0.5


def untestable(before: ModelComparison) -> list[tuple[str, str]]:
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
