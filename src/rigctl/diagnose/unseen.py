"""The model on the records that no fit saw: as good as on the others, or what it still misses there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from rigctl.compare.compare import judge
from rigctl.compare.fitting import fit_model
from rigctl.compare.localise import variable_units
from rigctl.compare.result import Comparison, ModelComparison
from rigctl.diagnose.error_course import error_course
from rigctl.diagnose.remedies import remedies
from rigctl.diagnose.search import Tell
from rigctl.diagnose.unseen_group import Unseen
from rigctl.diagnose.unseen_wording import unseen_sentences
from rigctl.model.fit.fit import FitResult
from rigctl.model.measured.record import MeasuredRecord
from rigctl.units import show

_FEW, _MOST_VARIABLES = 4, 2


def unseen(compared: Comparison, model: ModelComparison, *, tell: Tell | None = None) -> tuple[Unseen, ...]:
    """Judge `model` on the records that `compared` left out: held out, and not chosen.

    Raises
    ------
    RigctlError
        the model cannot be simulated there.
    """
    said = tell or (lambda _: None)
    problem, choice = model.fit.problem, compared.choice
    inside = [problem.records[k] for k in model.fit.fitted]
    found = []
    if model.fit.held_out:
        said("Looking at the records that were held out")
        there = replace(model.fit, fitted=model.fit.held_out, solution=None)
        found.append(_group(model, inside, there, "hold_out", choice.hold_out))
    if choice.rest is not None:
        said("Looking at the records that were not chosen")
        measurements, noise = choice.rest
        there = fit_model(model.fit.model, measurements, noise, refit=False)
        found.append(_group(model, inside, there, "only", choice.only))
    return tuple(found)


def _group(
    model: ModelComparison,
    inside: Sequence[MeasuredRecord],
    there: FitResult,
    why: Literal["hold_out", "only"],
    condition: str,
) -> Unseen:
    units = variable_units(model.fit.problem.measurements) | variable_units(there.problem.measurements)
    records = [there.problem.records[k] for k in there.fitted]
    plain = Unseen(why, condition, _what(records, inside, units), there, model.fit.errors)
    if plain.as_good:
        return _told(plain)
    judged = judge(there, model.name, excluded=model.excluded)
    wanted = [slot for slot in judged.slots[:1] if slot.log_evidence > 0.0]
    whole = replace(
        plain,
        course={name: error_course(there, name) for name in plain.worse},
        remedies=remedies(there, judged),
        slot=wanted[0].slot if wanted else "",
        slot_meaning=wanted[0].meaning if wanted else "",
    )
    return _told(whole)


def _told(found: Unseen) -> Unseen:
    return replace(found, sentences=tuple(one[0].upper() + one[1:] for one in unseen_sentences(found)))


def _what(group: Sequence[MeasuredRecord], inside: Sequence[MeasuredRecord], units: Mapping[str, str]) -> str:
    """The variables whose values the fitted records do not have, with these values."""
    told = []
    for name in dict.fromkeys(name for record in group for name in record.condition):
        own = {_rounded(record.condition[name]) for record in group if name in record.condition}
        others = {_rounded(record.condition[name]) for record in inside if name in record.condition}
        if own & others or not others:
            continue
        values = sorted(own)
        if len(values) <= _FEW:
            told.append(f"{name} {', '.join(show(value, units[name], digits=3) for value in values)}")
        else:
            ends = (show(value, units[name], digits=3) for value in (values[0], values[-1]))
            told.append(f"{name} {' to '.join(ends)}")
    return ", ".join(told[:_MOST_VARIABLES])


def _rounded(value: float) -> float:
    return float(np.format_float_scientific(value, precision=4))
