"""Survey many runs with one model: evaluate each, test every quantity for a change, refit what changed.

In: runs and a model. Out: a `Survey`: a line for each entry, the quantities that change, and which effect
has changed. Entries are evaluated independently of each other, in any number of processes, and only their
normal equations are kept (`evaluation`); whether anything changes is tested by ranks (`multiplicity`), and
what it is is found by a diagnosis (`changed_effect`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Final

import numpy as np

from rigctl.analysis.fitting import fit_problem, no_progress
from rigctl.analysis.linear.candidates import Candidate, by_effect, candidates, data_ranges
from rigctl.argument_types import checks_argument_types
from rigctl.dataset import Run
from rigctl.dataset.copies import without_copies
from rigctl.engine.one_thread import one_thread
from rigctl.errors import ExitCode, RigctlError, unknown_name
from rigctl.model.measured.conditions import variable_units
from rigctl.model.measured.hold_out import check_condition, require_names
from rigctl.model.measured.record import Measurements
from rigctl.model.model import Model
from rigctl.monitoring.changed_effect import name_changes, not_diagnosed, parameters_of
from rigctl.monitoring.entries import Entries, Entry, entries_of
from rigctl.monitoring.evaluation import Failure, Plan, Reading, measured, problem_of, read_entry
from rigctl.monitoring.multiplicity import Quantity, judge
from rigctl.monitoring.result import Line, Survey
from rigctl.tasks import Countdown, Workers, map_tasks

#: number of entries tried for the starting values of the fits
_TRIED: Final = 5


@checks_argument_types
@one_thread()
def survey(
    runs: Sequence[Run],
    model: Model,
    *,
    by: str = "run",
    over: str | None = None,
    share: Sequence[str] = (),
    effects: Sequence[str] | None = None,
    only: str | None = None,
    assume: Sequence[str] = (),
    name: bool = True,
    notes: Sequence[str] = (),
    workers: Workers | None = None,
    on_progress: Callable[[str], None] | None = None,
) -> Survey:
    """Evaluate many runs with one model: which quantities change, since when, and with what certainty.

    Parameters
    ----------
    by: ``run``, ``record``, ``day``, ``week``, ``month``, or a column of the records.
    over: ``date``, ``order``, or a column, an argument or a channel.
    share: parameters common to all runs, held at the model's values; ``all`` for every one. The other
        parameters that the model's file frees are fitted in each run.
    effects: effects to test besides the model's own; by default every one that the model may lack.
    only, assume: as for `rigctl compare`.
    notes: remarks on the runs, repeated in the result; those on the data of each run are in its line.
    name: diagnose a run after a change, and fit the effect that is named in every run; False reports only
        what changes.

    Raises
    ------
    RigctlError
        nothing is tested, a name or a column is unknown, or no run can be read.
    """
    report = on_progress or no_progress
    if only is not None:
        require_names(only, model, runs)
    # 1. What is a point of the survey, and what is free in each of them.
    shared = _shared(model, share)
    freed = tuple(name for name in model.fitted if name not in shared)
    runs, copies = without_copies(runs)
    ordered = entries_of(runs, by, over)
    if only is not None:
        report(f"Looking for what --only names: {only}")
        _require_condition(Plan(model, freed, (), (), None, tuple(assume)), ordered.entries, only)
    # 2. Starting values from the first entry that can be fitted, and one shape of each effect for all
    #    entries.
    started, picked = _starting_model(model, freed, ordered.entries, only, tuple(assume), effects, report)
    plan = Plan(started, freed, shared, picked, only, tuple(assume))
    quantities = _quantities(plan)
    if not quantities:
        raise RigctlError(
            "there is nothing to survey: the model has no free parameter, and no effect is selected",
            hint="Mark parameters with 'fit: true', or name effects with '--effects'",
        )
    # 3. Every entry by itself, in any process. One that cannot be read is a line of the result, not the end
    #    of it.
    outcomes = _read(plan, ordered.entries, workers, report, "Reading")
    indices = [k for k, one in enumerate(outcomes) if isinstance(one, Reading)]
    if not indices:
        why, *_ = (one.reason for one in outcomes if isinstance(one, Failure))
        raise RigctlError(f"no run could be read; the first failed: {why}", exit_code=ExitCode.FAILED)
    readings = [one for one in outcomes if isinstance(one, Reading)]
    where = np.array([ordered.entries[k].place for k in indices])
    report("Looking for changes")
    # 4. Which quantities change, at one level for all; 5. what has changed, which is another question.
    judged = judge(plan, readings, where, quantities)
    entries = [ordered.entries[k] for k in indices]

    def again(other: Plan, what: str) -> list[Reading | None]:
        read = _read(other, entries, workers, report, f"Fitting with {what}")
        return [one if isinstance(one, Reading) else None for one in read]

    named = (
        name_changes(plan, entries, readings, judged, again, report)
        if name and plan.candidates
        else not_diagnosed(judged)
    )
    return Survey(
        model=model.name,
        freed=plan.freed,
        held=plan.held,
        axis=ordered.axis,
        lines=tuple(_lines(ordered, outcomes)),
        judged=judged,
        named=named,
        notes=(*notes, *_copy_notes(copies), *ordered.notes),
    )


def _require_condition(plan: Plan, entries: Sequence[Entry], only: str) -> None:
    """Refuse a condition whose names no run has, before anything is fitted.

    Runs may differ in their columns, and only the last one may have a name: all are asked until one has it.

    Raises
    ------
    RigctlError
        no run has them, or it is not a condition.
    """
    refused: RigctlError | None = None
    for entry in entries:
        try:
            measurements = measured(plan, entry.runs).measurements
        except RigctlError:  # it is reported with the others
            continue
        try:
            check_condition(measurements, only, variable_units(measurements))
        except RigctlError as problem:
            refused = refused or problem
        else:
            return
    if refused is not None:
        raise refused


def _copy_notes(copies: Sequence[tuple[Run, Run]]) -> Iterator[str]:
    if copies:
        (copy, original), *more = copies
        others = f", and {len(more)} more runs are copies too" if more else ""
        yield f"left out: {copy.id} holds the same measurements as {original.id}{others}"


def _lines(ordered: Entries, outcomes: Sequence[Reading | Failure]) -> Iterator[Line]:
    read = 0
    for entry, outcome in zip(ordered.entries, outcomes, strict=True):
        if isinstance(outcome, Reading):
            yield Line(entry, outcome, "", read)
            read += 1
        else:
            yield Line(entry, None, outcome.reason)


def _shared(model: Model, share: Sequence[str]) -> tuple[str, ...]:
    """The parameters that are held, in the model's order."""
    if list(share) == ["all"]:
        return model.fitted
    for name in share:
        if name not in model.fitted:
            raise unknown_name("free parameter of the model", name, ["all", *model.fitted])
    return tuple(name for name in model.fitted if name in share)


def _starting_model(
    model: Model,
    freed: tuple[str, ...],
    entries: Sequence[Entry],
    only: str | None,
    assume: tuple[str, ...],
    effects: Sequence[str] | None,
    report: Callable[[str], None],
) -> tuple[Model, tuple[Candidate, ...]]:
    """The model with the starting values of the fits, from the first run that can be fitted; and the effects
    to test."""
    picked = _picked(model, None, effects)
    trial = Plan(model, freed, (), (), only, assume)
    for entry in entries[:_TRIED]:
        report(f"Fitting {model.name} to {entry.label}, for starting values of the other fits")
        try:
            problem, data = problem_of(trial, entry)
            picked = _picked(model, data.measurements, effects)
            if not freed:
                return model, picked
            fitted = fit_problem(problem, data.noise)
        except RigctlError:  # it is reported with the others
            continue
        fitted_values = dict(zip((one.name for one in fitted.problem.shared), fitted.values, strict=True))
        inside = {
            n: float(fitted_values[n]) for n in freed if n in fitted_values and n not in fitted.at_bound
        }
        return model.with_values(inside), picked
    return model, picked


def _picked(
    model: Model, measurements: Measurements | None, wanted: Sequence[str] | None
) -> tuple[Candidate, ...]:
    """One candidate for each effect, see `_typical`.

    All runs are evaluated with the same shapes; otherwise the sizes would not be comparable.
    """
    ranges = {} if measurements is None else data_ranges(model.family, measurements)
    tried = candidates(model, ranges=ranges)
    indices_by_effect = by_effect(tried)
    if wanted is not None and list(wanted) == ["none"]:
        wanted = ()
    for name in wanted or ():
        if name not in indices_by_effect:
            raise unknown_name("effect that the model may lack", name, ["none", *indices_by_effect])
    chosen = (
        indices_by_effect
        if wanted is None
        else {name: indices_by_effect[name] for name in indices_by_effect if name in wanted}
    )
    return tuple(_typical([tried[index] for index in indices]) for indices in chosen.values())


def _typical(shapes: Sequence[Candidate]) -> Candidate:
    """The candidate with the shape at which its declaration starts; otherwise the middle of the grid."""
    middle = shapes[len(shapes) // 2]
    return next((one for one in shapes if not one.shapes and not one.secants), middle)


def _quantities(plan: Plan) -> list[Quantity]:
    """Everything that is tested: the parameters, and each effect by its first parameter."""
    indices = {name: k for k, name in enumerate(plan.columns)}
    quantities = parameters_of(plan, (*plan.freed, *plan.held))
    for one in plan.candidates:
        first = one.parameter(one.columns[0])
        quantities.append(
            Quantity(
                one.name,
                "effect",
                indices[one.columns[0]],
                tuple(indices[name] for name in one.columns[1:]),
                first.at_null,
                first.unit,
                one.effect.summary,
                first.difference,
            )
        )
    return quantities


def _read(
    plan: Plan,
    entries: Sequence[Entry],
    workers: Workers | None,
    report: Callable[[str], None],
    doing: str,
) -> list[Reading | Failure]:
    """Every entry evaluated with the plan, in order, here or in worker processes."""
    done = Countdown(doing, report)
    outcomes = dict(map_tasks(partial(read_entry, plan), entries, workers, on_progress=done))
    return [outcomes[k] for k in range(len(entries))]
