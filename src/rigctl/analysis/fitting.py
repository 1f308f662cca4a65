"""From runs to a fitted model: the measurements, the records that the fit does not see, and the fit.

In: runs, a model, and conditions on records (`read_runs`). Out: a `FitResult` in the noise that its own
residuals show (`fit_to_data`). Noise and fit depend on each other: the noise weighs the fit, and only a
fitted model says which readings are spikes and when the bench is at rest. They are therefore found in turn,
in the order that `fit_problem` gives with its reasons.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import count

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.comparison_result import Choice
from rigctl.dataset.run import Run
from rigctl.engine.least_squares import Iteration, Refused, Unknown, started
from rigctl.engine.one_thread import one_thread
from rigctl.errors import RigctlError
from rigctl.model.fit.fit import FitResult, fit
from rigctl.model.fit.problem import Problem, make_problem
from rigctl.model.fit.reached_bounds import with_wider_bounds
from rigctl.model.fit.switching import MOST_SEPARATE
from rigctl.model.measured.assumed import assumed_when_opened
from rigctl.model.measured.conditions import variable_units
from rigctl.model.measured.copies import copies_in, copy_notes, each_once
from rigctl.model.measured.hold_out import chosen, held_out
from rigctl.model.measured.noise import DataNoise, noise_of, with_noise_off_model, with_spikes_off_model
from rigctl.model.measured.note import as_notes
from rigctl.model.measured.read import read_measurements
from rigctl.model.measured.record import Measurements
from rigctl.model.measured.standing import (
    at_floor,
    floor_alone,
    white_noise,
    with_standing,
    with_what_is_left,
    without_doubtful_slow_noise,
)
from rigctl.model.model import Model

#: share of a channel's variance below which a model has not locked on to it, and number of starts then tried
_LOCKED, _STARTS = 0.3, 6
#: a channel whose error is less than this many times its noise hardly moves
_MOVES = 3.0
#: correlation of neighbouring readings beyond which a weight may be wrong, and ratio of two errors of one
#: model from which it was
_CORRELATED, _WORSE = 0.3, 1.1
#: with more unknown switch times than this share of the readings, any error would fall to the floor
_SHARE_OF_READINGS = 0.2
#: an error below this many times the white floor is as small as an error can be
_AT_FLOOR = 1.4
#: readings that differ from an input by less than this share of its range are a copy of it
_EQUAL = 1e-6

#: called with a description of the current step
OnProgress = Callable[[str], None]


def no_progress(_: str) -> None:
    """Ignore progress."""


@dataclass(frozen=True)
class Data:
    """The data to which a model is fitted and by which it is judged.

    Attributes
    ----------
    measurements, noise: the records, and their noise.
    held_out: indices of the records that no fit sees.
    choice: the selection requested, and the records that it excludes.
    numbers: the number of each record in conditions: ``record == 2``.
    """

    measurements: Measurements
    noise: DataNoise
    held_out: tuple[int, ...]
    choice: Choice = field(default_factory=Choice)
    numbers: tuple[int, ...] = ()


def read_runs(
    model: Model,
    runs: Sequence[Run],
    *,
    hold_out: str | None = None,
    only: str | None = None,
    on_progress: OnProgress = no_progress,
) -> Data:
    """The usable records of `runs` as seen by `model` and every other model of its family and rig.

    Parameters
    ----------
    hold_out: a condition that selects the records to be held out of every fit, e.g. ``oil == 60 degC``.
    only: a condition that selects the records to be used; the noise is learned from all records.

    Raises
    ------
    RigctlError
        the runs are not of the model's bench, or a condition selects none or all of the records.
    """
    on_progress("Reading the records")
    measurements = read_measurements(model, runs)
    _require_own_readings(measurements)
    _require_moving_readings(measurements)
    units = variable_units(measurements)
    # Selected and held out by the records' numbers, which those that repeat another one have too, and before
    # anything is estimated. Only the noise is estimated from all records, also from those not selected.
    selected = chosen(measurements, only, units)
    held = {selected[at] for at in held_out(measurements.only(selected), hold_out, units, only)}
    measurements, kept = _each_once(measurements, selected, held)
    noise = noise_of(measurements)
    choice = Choice(hold_out or "", only or "", assumed_when_opened(runs))
    used = set(selected)
    indices = [at for at, index in enumerate(kept) if index in used]
    if only:
        others = sorted(set(range(len(kept))) - set(indices))
        rest = (measurements.only(others), noise.only(others)) if others else None
        choice = replace(choice, rest=rest)
        measurements, noise = measurements.only(indices), noise.only(indices)
    unseen = tuple(at for at, index in enumerate(indices) if kept[index] in held)
    return Data(measurements, noise, unseen, choice, tuple(kept[at] + 1 for at in indices))


def _each_once(
    measurements: Measurements, selected: Sequence[int], held: Collection[int]
) -> tuple[Measurements, list[int]]:
    """Return the measurements with each sample once, and the indices of the records that remain.

    Of copies, the one that is fitted is kept: what a fit has seen must not judge it.

    Raises
    ------
    RigctlError
        each of the records that are held out is a copy of one that is not.
    """
    records = measurements.records
    order = [*(index for index in selected if index not in held), *selected]
    copies = copies_in(measurements, order)
    remarks = tuple(copy_notes(records, copies, held))
    if held and all(index in copies.whole for index in held):
        raise RigctlError(
            "nothing that is held out is unseen: each of these records repeats one that is fitted",
            value=", ".join(records[index].label for index in sorted(held)),
            expected=remarks[0],
        )
    once, kept = each_once(measurements, copies)
    return replace(once, notes=(*as_notes(remarks), *measurements.notes)), kept


def _require_moving_readings(measurements: Measurements) -> None:
    """Refuse records in which no channel ever changes although an input does: a sensor that is stuck."""
    if measurements.table or not measurements.outputs:
        return
    readings = np.concatenate([record.values for record in measurements.records])
    moved = any(
        float(np.ptp(record.input_course(index))) > 0.0
        for record in measurements.records
        for index in range(len(measurements.inputs))
    )
    spans = [column[np.isfinite(column)] for column in readings.T]
    if moved and all(column.size and float(np.ptp(column)) == 0.0 for column in spans):
        raise RigctlError(
            "its readings never change, although an input does",
            value=", ".join(measurements.outputs),
            expected="a sensor that is not stuck",
            hint="Leave the record out, or give another channel",
        )


def _require_own_readings(measurements: Measurements) -> None:
    """Refuse a reading that is an input: a model would be compared with what it is given."""
    for column, output in enumerate(measurements.outputs if not measurements.table else ()):
        for index, name in enumerate(measurements.inputs):
            pairs = [
                (record.values[:, column], record.input_course(index)) for record in measurements.records
            ]
            readings, courses = (np.concatenate(each) for each in zip(*pairs, strict=True))
            good = np.isfinite(readings)
            span = float(np.ptp(courses[good])) if good.any() else 0.0
            if span > 0.0 and float(np.max(np.abs(readings[good] - courses[good]))) < _EQUAL * span:
                raise RigctlError(
                    f"its readings are those of the input {name}",
                    value=output,
                    expected="a channel that was measured by itself",
                    hint="Map another column to one of the two",
                )


def fit_to_data(
    model: Model, data: Data, *, refit: bool = True, on_progress: OnProgress = no_progress
) -> FitResult:
    """Fit a model's free parameters; with `refit` False they keep their values.

    Raises
    ------
    RigctlError
        there are fewer values than parameters, or the model cannot be simulated.
    """
    what = f"Fitting {model.name}" if refit else f"Simulating {model.name}"
    on_progress(what)
    steps = count(1)
    return fit_model(
        model,
        data.measurements,
        data.noise,
        data.held_out,
        refit=refit,
        on_progress=on_progress,
        iterated=lambda _: on_progress(f"{what}: step {next(steps)}"),
    )


def fit_again(
    before: FitResult, model: Model, *, refit: bool = True, on_progress: OnProgress = no_progress
) -> FitResult:
    """Fit another model to the data of `before`, with the same noise and the same records held out."""
    again = before.problem.for_model(model, progress=on_progress)
    return fit_problem(again, noise_in(before), before.held_out, refit=refit, on_progress=on_progress)


def noise_in(fitted: FitResult) -> DataNoise:
    """The noise assumed in a fit."""
    problem = fitted.problem
    return DataNoise(problem.noise, problem.ok, grown=problem.grown)


def fit_model(
    model: Model,
    measurements: Measurements,
    noise: DataNoise,
    held_out: Sequence[int] = (),
    *,
    refit: bool = True,
    known: Mapping[str, float] | None = None,
    on_progress: OnProgress = no_progress,
    iterated: Callable[[Iteration], None] | None = None,
) -> FitResult:
    """Fit a model's free parameters to measurements; see `rigctl.model.fit.fit.fit`.

    Without `refit` the properties of the logger are still fitted, such as the delay with which it writes
    switches. Those `known`, by name and SI, keep their values.
    """
    problem = make_problem(
        model, measurements, noise.model, noise.ok, grown=noise.grown, progress=on_progress
    )
    if known:
        problem = problem.with_known(known)
    return fit_problem(problem, noise, held_out, refit=refit, on_progress=on_progress, iterated=iterated)


@one_thread()
def fit_problem(
    problem: Problem,
    noise: DataNoise,
    held_out: Sequence[int] = (),
    *,
    refit: bool = True,
    local: Sequence[NDArray[np.float64]] | None = None,
    cost: float | None = None,
    on_progress: OnProgress = no_progress,
    iterated: Callable[[Iteration], None] | None = None,
) -> FitResult:
    """Fit a model to its measurements, and again with the noise that its residuals show.

    `local` are the record-level unknowns from which the fit starts, and `cost` the relative reduction below
    which it ends, as in `rigctl.model.fit.fit.fit`. `iterated` is called with each iteration; an exception
    that it raises ends the fit.
    """
    # The order matters. Every step needs the predictions of the fit before it, and each one that changes the
    # noise is followed by another fit, which starts where the last one ended:
    # 1. a first fit. What windows took for slow noise may be the signal itself, and would lead it astray;
    # 2. spikes in its residuals;
    # 3. what is known of the noise, now that the model says where the bench rests;
    # 4. how the noise depends on the level;
    # 5. where only the white floor is known, what the model leaves is the scale of its errors;
    # 6. if uncertain times of many switches may be what it leaves: with each of them as an unknown.
    if not refit:
        kept = (*problem.model.fitted, *problem.model.assumed)
        problem = problem.with_shared([one for one in problem.shared if one.name not in kept])
    ends = fit if cost is None else partial(fit, cost=cost)
    first = without_doubtful_slow_noise(noise)
    begun = problem if first is None else _in_noise(problem, first, on_progress)
    result = ends(begun, held_out, refit=bool(problem.shared), local=local, progress=iterated)
    if refit and not local:
        result = _locked_on(result, on_progress)

    def wider(fitted: FitResult, shared: Sequence[Unknown]) -> FitResult:
        within = fitted.problem.with_shared(shared)
        return ends(within, held_out, local=fitted.local, progress=iterated)

    def again(fitted: FitResult, noise: DataNoise) -> FitResult:
        fitted = fit_in_noise(fitted, noise, refit=refit, on_progress=on_progress, iterated=iterated)
        return with_wider_bounds(fitted, wider) if refit else fitted

    if refit:
        result = with_wider_bounds(result, wider)
    for learn in (_spikes_off, _standing, _noise_off, _left, _left):
        cleaned = learn(result, noise)
        if cleaned is not None:
            noise = cleaned
            if learn is not _spikes_off or first is None:
                result, first = again(result, noise), None
    if first is not None:  # the slow noise was real
        result = again(result, noise)
    if not refit:
        return result
    if not local:
        result = _with_separate_switches(result, noise, again, on_progress)
    return _no_worse_than_least_squares(result, noise_in(result), again)


def _with_separate_switches(
    fitted: FitResult,
    noise: DataNoise,
    again: Callable[[FitResult, DataNoise], FitResult],
    on_progress: OnProgress,
) -> FitResult:
    """The fit, or one with an unknown for each of up to a hundred switches, if that leaves only the floor."""
    before = fitted.problem
    channels = [one for one in noise.model.channels if one.own_scale]
    if before.scatter is None or all(fitted.errors[c.name].rmse < _AT_FLOOR * c.floor for c in channels):
        return fitted
    measurements = before.measurements
    for record, good in zip(measurements.records, before.ok, strict=True):
        count = record.rough_switches.size
        if count > MOST_SEPARATE or count > _SHARE_OF_READINGS * good.sum():
            return fitted
    on_progress(f"Fitting {before.model.name} with the time of every switch")
    records = tuple(replace(record, separate_switches=True) for record in measurements.records)
    floor = at_floor(noise)
    problem = make_problem(
        before.model, replace(measurements, records=records), floor.model, floor.ok, grown=floor.grown
    )
    free = {one.name for one in before.shared}
    problem = _started_at(problem, fitted, [one for one in problem.shared if one.name in free])
    with suppress(RigctlError):  # it cannot be simulated with such times: they stay part of the noise
        result = fit(problem, fitted.held_out)
        if all(result.errors[one.name].rmse < _AT_FLOOR * one.floor for one in channels):
            left = _left(result, floor)
            return result if left is None else again(result, left)
    return fitted


def _spikes_off(fitted: FitResult, noise: DataNoise) -> DataNoise | None:
    errors = [fitted.normalised_error(index) for index in range(len(fitted.problem.records))]
    return with_spikes_off_model(noise, fitted.problem.measurements, errors)


def _standing(fitted: FitResult, noise: DataNoise) -> DataNoise | None:
    return with_standing(noise, fitted.problem.measurements, fitted.likely_outputs)


def _noise_off(fitted: FitResult, noise: DataNoise) -> DataNoise | None:
    return with_noise_off_model(noise, fitted.problem.measurements, fitted.likely_outputs)


def _left(fitted: FitResult, noise: DataNoise) -> DataNoise | None:
    return with_what_is_left(
        noise, fitted.problem.measurements, fitted.likely_outputs, fitted.fitted, unknowns=fitted.unknowns
    )


def _no_worse_than_least_squares(
    fitted: FitResult, noise: DataNoise, again: Callable[[FitResult, DataNoise], FitResult]
) -> FitResult:
    """The fit, or that by ordinary least squares if slow noise as a weight made it considerably worse.

    Weighted by a correlated noise, a fit gives up a little of its error on its own data for smaller
    uncertainties. If it gives up much, the noise was no noise, but error of the model. A linear problem tells
    whether the repetition is worth while.
    """
    slow = [one.name for one in noise.model.channels if one.correlation > _CORRELATED and one.floor]
    if not slow or fitted.solution is None:
        return fitted
    plain = white_noise(noise, slow)
    problem = _in_noise(fitted.problem, plain, no_progress)
    if _removable(problem, fitted) < 1.0 - 1.0 / _WORSE**2:
        return fitted
    other = again(fitted, plain)
    worse = [name for name in slow if fitted.errors[name].rmse > _WORSE * other.errors[name].rmse]
    if not worse:
        return fitted
    because = "weighted by the noise that windows showed, a fit leaves more than ordinary least squares"
    floor = floor_alone(noise, worse, because)
    if floor is None:
        return fitted
    result = again(other, floor)
    left = _left(result, floor)
    return result if left is None else again(result, left)


def _removable(problem: Problem, fitted: FitResult) -> float:
    """The share of the squared error that a linear step of the shared unknowns would remove."""
    inner = problem.only(fitted.fitted)
    blocks = inner.evaluate(fitted.values, [fitted.local[k] for k in fitted.fitted], True)
    if isinstance(blocks, Refused) or not blocks or blocks[0].shared is None:
        return 0.0
    columns = np.vstack([block.shared for block in blocks if block.shared is not None])
    residual = np.concatenate(
        [block.residual[: block.shared.shape[0]] for block in blocks if block.shared is not None]
    )
    basis = np.linalg.qr(columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300))[0]
    along = basis.T @ residual
    return float(along @ along) / max(float(residual @ residual), 1e-300)


def _locked_on(fitted: FitResult, on_progress: OnProgress) -> FitResult:
    """The fit, or a better one from another start if it follows none of what a channel does.

    An oscillation of the wrong frequency, or a lag longer than the record, leaves a local minimum in which a
    model predicts hardly more than a mean.
    """
    lost = [one for one in fitted.errors.values() if one.r2 < _LOCKED and one.nrmse > _MOVES]
    if not lost or not fitted.problem.shared or fitted.solution is None:
        return fitted
    on_progress(f"Fitting {fitted.problem.model.name} from other starting values")
    with suppress(RigctlError):  # no start can be simulated: the first fit is kept
        again = fit(fitted.problem, fitted.held_out, starts=_STARTS)
        if again.solution is not None and again.solution.cost < fitted.solution.cost:
            return again
    return fitted


def _in_noise(problem: Problem, noise: DataNoise, on_progress: OnProgress) -> Problem:
    """The problem with another noise of the same data."""
    again = problem.for_model(problem.model, noise.model, noise.ok, grown=noise.grown, progress=on_progress)
    return again.with_unknowns_of(problem)


def fit_in_noise(
    before: FitResult,
    noise: DataNoise,
    *,
    refit: bool = True,
    on_progress: OnProgress = no_progress,
    iterated: Callable[[Iteration], None] | None = None,
) -> FitResult:
    """The fit repeated with another noise of the same data, starting where it ended."""
    problem = before.problem
    again = problem.for_model(problem.model, noise.model, noise.ok, grown=noise.grown, progress=on_progress)
    if not refit:
        again = again.with_unknowns_of(problem)
    again = _started_at(again, before, again.shared)
    return fit(again, before.held_out, refit=bool(again.shared), local=before.local, progress=iterated)


def _started_at(problem: Problem, before: FitResult, shared: Sequence[Unknown]) -> Problem:
    """The problem with these shared unknowns, which start where those of a fit have ended.

    Bounds of the model's own parameters that the fit moved outwards stay there.
    """
    known = {one.name: one for one in before.problem.shared if "." not in one.name}
    shared = [_no_narrower(one, known[one.name]) if one.name in known else one for one in shared]
    ended = {one.name: value for one, value in zip(before.problem.shared, before.values, strict=True)}
    starts = np.array([ended.get(one.name, one.start) for one in shared])
    return problem.with_shared(started(shared, starts))


def _no_narrower(one: Unknown, other: Unknown) -> Unknown:
    return replace(one, lower=min(one.lower, other.lower), upper=max(one.upper, other.upper))


def require_free_parameters(model: Model) -> None:
    """Require that the model has a free parameter.

    Raises
    ------
    RigctlError
        it has none.
    """
    if not model.fitted:
        raise RigctlError(
            f"the model '{model.name}' has no free parameters: any error of its values would be mistaken for "
            "missing physics",
            hint="Mark the parameters that are not known exactly with 'fit: true' in the model file",
        )
