"""The model on the records that no fit saw: as good as on the others, or what it still misses there.

The records are judged in groups of one condition: by their error, by the time series of the error within a
record, and by what would remove it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from rigctl.analysis.agreement.error_course import error_course
from rigctl.analysis.comparison import judge
from rigctl.analysis.comparison_result import Comparison, ModelComparison
from rigctl.analysis.fitting import OnProgress, fit_model, no_progress
from rigctl.analysis.held_out_group import MOST_VARIABLES, HeldOutGroup
from rigctl.analysis.remedies import remedies
from rigctl.model.fit.fit import FitResult
from rigctl.model.measured.conditions import variable_units
from rigctl.model.measured.record import MeasuredRecord
from rigctl.units import show

#: most values of a variable that are listed one by one
_FEW = 4


def unseen(
    compared: Comparison, model: ModelComparison, *, on_progress: OnProgress | None = None
) -> tuple[HeldOutGroup, ...]:
    """Judge `model` on the records that `compared` left out: held out, or not selected.

    Raises
    ------
    RigctlError
        the model cannot be simulated there.
    """
    report = on_progress or no_progress
    problem, choice = model.fit.problem, compared.choice
    inside = [problem.records[k] for k in model.fit.fitted]
    evaluated = []
    if model.fit.held_out:
        report("Evaluating the records that were held out")
        # The records were simulated in the same problem: only what counts as fitted changes. Their own
        # unknowns were fitted to them, the model's were not.
        result = replace(model.fit, fitted=model.fit.held_out, solution=None)
        evaluated.append(_group(model, inside, result, "hold_out", choice.hold_out))
    if choice.rest is not None:
        report("Evaluating the records that were not selected")
        # These records are a problem of their own, in their own noise. Errors of calibrations that both have
        # in common keep the values that the fitted records determined.
        measurements, noise = choice.rest
        # one calibration, or clock, is off by the same in all records made under it
        measurements = replace(measurements, reading_errors=problem.measurements.reading_errors)
        fitted = {record.run for record in inside}  # of a later calibration, these records tell nothing
        known = {one.name for one in measurements.reading_errors if any(map(one.acts_in, fitted))}
        values = {
            u.name: float(value)
            for u, value in zip(problem.shared, model.fit.values, strict=True)
            if u.name in known
        }
        result = fit_model(model.fit.at_end, measurements, noise, refit=False, known=values)
        evaluated.append(_group(model, inside, result, "only", choice.only))
    return tuple(evaluated)


def _group(
    model: ModelComparison,
    inside: Sequence[MeasuredRecord],
    result: FitResult,
    why: Literal["hold_out", "only"],
    condition: str,
) -> HeldOutGroup:
    units = variable_units(model.fit.problem.measurements) | variable_units(result.problem.measurements)
    records = [result.problem.records[k] for k in result.fitted]
    plain = HeldOutGroup(why, condition, _what(records, inside, units), result, model.fit.errors)
    if plain.as_good:
        return plain
    judged = judge(result, model.name, excluded=model.excluded, sensors=False)
    wanted = [slot for slot in judged.slots[:1] if slot.log_evidence > 0.0]
    return replace(
        plain,
        course={name: error_course(result, name) for name in plain.worse},
        remedies=remedies(result, judged),
        slot=wanted[0].slot if wanted else "",
        slot_meaning=wanted[0].meaning if wanted else "",
    )


def _what(group: Sequence[MeasuredRecord], inside: Sequence[MeasuredRecord], units: Mapping[str, str]) -> str:
    """The variables whose values do not occur in the fitted records, with these values."""
    parts = []
    for name in dict.fromkeys(name for record in group for name in record.condition):
        group_values = {_rounded(record.condition[name]) for record in group if name in record.condition}
        others = {_rounded(record.condition[name]) for record in inside if name in record.condition}
        if group_values & others or not others:
            continue
        values = sorted(group_values)
        if len(values) <= _FEW:
            parts.append(f"{name} {', '.join(show(value, units[name], digits=3) for value in values)}")
        else:
            ends = (show(value, units[name], digits=3) for value in (values[0], values[-1]))
            parts.append(f"{name} {' to '.join(ends)}")
    return ", ".join(parts[:MOST_VARIABLES])


def _rounded(value: float) -> float:
    return float(np.format_float_scientific(value, precision=4))
