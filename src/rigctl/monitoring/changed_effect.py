"""Which effect has changed: a diagnosis of a run with a clear change, then a fit of all runs.

The series of a single effect shows that something has changed, but hardly what: effects with similar
signatures follow each other, and large changes are not linear. So a run after the change is diagnosed as by
`rigctl diagnose`, with all parameters that the model's file frees, refits, held-out records and classes of
indistinguishable effects. The named effect is added to the model, and every run is fitted again with its size
free: a constant deficiency of the model then has a constant size, and only what changes is reported.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np

from rigctl.analysis.comparison import judge as compared
from rigctl.analysis.decision_levels import SLIGHT
from rigctl.analysis.diagnosis import diagnose_comparison
from rigctl.analysis.diagnosis_result import Diagnosis, Verdict
from rigctl.analysis.fitting import fit_problem
from rigctl.effects.declaration import Effect, qualified
from rigctl.errors import RigctlError
from rigctl.model.value_table import stated_values
from rigctl.monitoring.entries import Entry
from rigctl.monitoring.evaluation import Plan, Reading, problem_of
from rigctl.monitoring.multiplicity import Change, Judged, Quantity, QuantitySeries, Tested, change_of, judge

#: least number of readings in a diagnosis; runs with fewer, such as rows of a table, are combined
_SAMPLES: Final = 60
_MOST_RUNS: Final = 40
#: the diagnosed run is the median one among this share of the runs, those that have moved most
_MOVED: Final = 0.25


@dataclass(frozen=True)
class Naming:
    """How the cause of a change was determined, or why it was not.

    Attributes
    ----------
    kind: ``by_diagnosis`` if a diagnosis of one run named it; else what prevented that.
    names: the effects or parameters concerned, or the run.
    problem: why the run could not be diagnosed.
    """

    kind: Literal[
        "by_diagnosis",
        "not_diagnosed",
        "run_failed",
        "outside_library",
        "too_little",
        "parameters_free",
        "no_single_change",
    ]
    names: tuple[str, ...] = ()
    problem: str = ""


@dataclass(frozen=True)
class Named:
    """What has changed, and how that was determined.

    Attributes
    ----------
    changes: the most significant first.
    verdict: of the diagnosis; empty if none could be made.
    naming: how the changes were named; None where no question was left.
    courses: the series with the named effects in the model; none if nothing was named.
    """

    changes: tuple[Change, ...]
    verdict: str = ""
    naming: Naming | None = None
    courses: tuple[QuantitySeries, ...] = ()


def name_changes(
    plan: Plan,
    entries: Sequence[Entry],
    readings: Sequence[Reading],
    judged: Judged,
    read: Callable[[Plan, str], Sequence[Reading | None]],
    report: Callable[[str], None],
) -> Named:
    """Name what has changed.

    Parameters
    ----------
    entries, readings: those that could be read, in order.
    read: reads all of them with another plan.
    """
    changed = judged.changed
    if not changed:
        return Named(())
    # 1. One run in which the change is large: over several, the change itself would be a misfit between runs.
    chosen = _plain(changed[0], entries, readings)
    report(f"Diagnosing {chosen.label}, where the change is clear")
    try:
        # 2. Its diagnosis, with held parameters freed. An adequate model means that parameters alone have
        #    changed.
        diagnosis = _diagnosed(plan, chosen)
    except RigctlError as problem:
        return _unnamed(judged, "", Naming("run_failed", (chosen.label,), str(problem).splitlines()[0]))
    if diagnosis.verdict is Verdict.ADEQUATE:
        return _of_parameters(plan, judged, diagnosis)
    if not diagnosis.effects or diagnosis.verdict in (Verdict.OUTSIDE_LIBRARY, Verdict.UNDECIDED):
        return _unnamed(judged, diagnosis.verdict.value, Naming("outside_library"))
    # 3. The named effects go into the model, and every run is read again: what the bench has always had gets
    #    a constant size.
    return _of_effects(plan, entries, judged, diagnosis, read)


def _plain(surest: Tested, entries: Sequence[Entry], readings: Sequence[Reading]) -> Entry:
    """A run, or enough of them for the readings needed, in the middle of those that have moved furthest."""
    # The median run among the quarter that has moved furthest from the level before the change: the furthest
    # of all may be an outlier.
    course = surest.course
    known = course.known
    begins = max(3, change_begins(surest))
    start = float(np.median(course.values[known[:begins]]))
    moved = known[np.argsort(-np.abs(course.values[known] - start), kind="stable")]
    most = moved[: max(1, round(_MOVED * moved.size))]
    chosen = int(np.searchsorted(known, most[len(most) // 2]))
    first = last = chosen
    while last - first + 1 < min(_MOST_RUNS, known.size):
        if sum(readings[int(k)].samples for k in known[first : last + 1]) >= _SAMPLES:
            break
        if last + 1 < known.size:  # later ones have changed as far
            last += 1
        else:
            first -= 1
    return together([entries[int(k)] for k in known[first : last + 1]])


def change_begins(tested: Tested) -> int:
    """The number of runs that determine the quantity before its change."""
    known = tested.course.known
    begins = change_of(tested, Judged((), 1.0, True)).shape.begins
    return int(np.searchsorted(known, begins))


def together(entries: Sequence[Entry]) -> Entry:
    """Several entries combined into one."""
    if len(entries) == 1:
        return entries[0]
    records = [one.records for one in entries]
    every = None if any(one is None for one in records) else tuple(r for one in records for r in one or ())
    runs = tuple(dict.fromkeys(run for one in entries for run in one.runs))
    return replace(entries[0], label=f"{entries[0].label} to {entries[-1].label}", runs=runs, records=every)


def _diagnosed(plan: Plan, entry: Entry) -> Diagnosis:
    free = replace(plan, freed=(*plan.freed, *plan.held), held=())
    problem, data = problem_of(free, entry)
    # a calibration is the same before and after: it does not explain a change
    before = compared(fit_problem(problem, data.noise), plan.model.name, sensors=False)
    return diagnose_comparison(before, data.measurements.runs)


def not_diagnosed(judged: Judged) -> Named:
    """What changes, without a diagnosis: parameters fitted together are reported separately."""
    changed = judged.changed
    if any(one.course.quantity.kind != "parameter" for one in changed):
        return _unnamed(judged, "", Naming("not_diagnosed"))
    return Named(tuple(change_of(one, judged) for one in changed))


def _unnamed(judged: Judged, verdict: str, why: Naming) -> Named:
    """The quantity with the largest gain, with every other that changed, as the cause is unknown."""
    first, *others = judged.changed
    alike = tuple(one.course.quantity.name for one in others)
    return Named((change_of(first, judged, alike),), verdict, why)


def _of_parameters(plan: Plan, judged: Judged, diagnosis: Diagnosis) -> Named:
    """The changed parameters, which are the cause if the model is adequate after the change."""
    parameters = [one for one in judged.changed if one.course.quantity.kind != "effect"]
    freed = [one for one in parameters if one.course.quantity.kind == "parameter"]
    if freed:
        return Named(tuple(change_of(one, judged) for one in freed), diagnosis.verdict.value)
    why = Naming("parameters_free", plan.held) if parameters else Naming("too_little")
    return _unnamed(judged, diagnosis.verdict.value, why)


def _of_effects(
    plan: Plan,
    entries: Sequence[Entry],
    judged: Judged,
    diagnosis: Diagnosis,
    read: Callable[[Plan, str], Sequence[Reading | None]],
) -> Named:
    """Every run read again with the named effects in the model, of which those that change are reported."""
    effects = [plan.model.effect(name) for name in diagnosis.effects]
    # The p-value stays that of the first test: the second one looks only at what a diagnosis has chosen
    # because it changes.
    again, quantities = _with_effects(plan, effects)
    outcomes = read(again, " and ".join(diagnosis.effects))
    indices = [k for k, one in enumerate(outcomes) if one is not None]
    readings = [one for one in outcomes if one is not None]
    where = np.array([entries[k].place for k in indices])
    second = _spread(judge(again, readings, where, quantities), indices, np.array([e.place for e in entries]))
    classes = {name: [n for n in group if n != name] for group in diagnosis.classes for name in group}
    changes = [
        replace(
            change_of(one, second, tuple(classes.get(one.course.quantity.name, ()))),
            p_value=judged.p_value,
            first_sure=judged.first_sure,
        )
        for one in _not_slight(second.changed)
    ]
    if not changes:
        why = Naming("no_single_change", tuple(diagnosis.effects))
        return _unnamed(judged, diagnosis.verdict.value, why)
    courses = tuple(one.course for one in second.tested)
    return Named(tuple(changes), diagnosis.verdict.value, Naming("by_diagnosis"), courses)


def _not_slight(changed: Sequence[Tested]) -> list[Tested]:
    """The changes, without those so small beside the first that they may be artefacts of its law's shape."""
    return [one for one in changed if one.gain >= SLIGHT * changed[0].gain]


def _spread(judged: Judged, indices: Sequence[int], over: np.ndarray) -> Judged:
    """Expand the results to every run; runs that could not be read again have no values."""
    if len(indices) == over.size:
        return judged
    tested = []
    for one in judged.tested:
        values, std = np.full(over.size, np.nan), np.full(over.size, np.nan)
        values[list(indices)], std[list(indices)] = one.course.values, one.course.std
        tested.append(replace(one, course=replace(one.course, values=values, std=std, over=over)))
    return replace(judged, tested=tuple(tested))


def _with_effects(plan: Plan, effects: Sequence[Effect]) -> tuple[Plan, list[Quantity]]:
    """The plan with effects in the model, their sizes free in every run; and the quantities tested then."""
    model = plan.model
    names: list[str] = []
    quantities: list[Quantity] = []
    for effect in effects:
        model = model.with_effect(effect, {})
        names += [qualified(effect.name, one.name) for one in effect.parameters if not one.shape]
    freed = (*plan.freed, *names)
    again = replace(plan, model=model, freed=freed, held=(), candidates=())
    for effect in effects:
        first, *_ = (one for one in effect.parameters if not one.shape)
        index = freed.index(qualified(effect.name, first.name))
        meaning, unit = effect.summary, first.unit
        quantities.append(Quantity(effect.name, "parameter", index, (), 0.0, unit, meaning, first.difference))
    quantities += parameters_of(again, plan.freed)
    return again, quantities


def parameters_of(plan: Plan, names: Sequence[str]) -> list[Quantity]:
    """Parameters of the model as quantities of a survey."""
    indices = {name: k for k, name in enumerate(plan.columns)}
    stated = {one.name: one for one in stated_values(plan.model)}
    return [
        Quantity(
            name,
            "parameter" if name in plan.freed else "held",
            indices[name],
            (),
            0.0 if name in plan.freed else plan.model.values[name],
            stated[name].unit,
            stated[name].meaning,
            stated[name].difference,
        )
        for name in names
    ]
