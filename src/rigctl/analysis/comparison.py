"""Compare models with measurements: how well they agree, and where they fail.

In: runs and models. Out: a `Comparison` with a `ModelComparison` for each, from which a diagnosis starts.
Each model is fitted, linearised once with the whole library, and tested. A fit and its tests are repeated
where they show that what they assume is wrong: a noise larger than the errors (`_without_refuted_noise`), or
sensors that are exact (`_with_sensors_in_question`).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from contextlib import suppress
from dataclasses import replace

from rigctl.analysis.agreement.adequacy import adequacy
from rigctl.analysis.agreement.located_error import LocatedError
from rigctl.analysis.comparison_result import Choice, Comparison, ModelComparison
from rigctl.analysis.decision_levels import BELOW_NOISE
from rigctl.analysis.fitting import (
    Data,
    OnProgress,
    fit_in_noise,
    fit_model,
    fit_to_data,
    no_progress,
    noise_in,
    read_runs,
)
from rigctl.analysis.linear.candidates import candidates, data_ranges, require_known
from rigctl.analysis.linear.linearisation import linearise
from rigctl.analysis.linear.nuisance_projection import project
from rigctl.analysis.linear.score_test import screen
from rigctl.analysis.linear.slopes import KnownSlopes
from rigctl.argument_types import checks_argument_types
from rigctl.dataset.run import Run
from rigctl.engine.one_thread import one_thread
from rigctl.errors import RigctlError
from rigctl.model.fit.fit import FitResult
from rigctl.model.fit.input_noise import input_noise_notes
from rigctl.model.measured.note import Note, as_notes
from rigctl.model.measured.standing import floor_alone, with_what_is_left
from rigctl.model.model import Model
from rigctl.model.reading_errors import ReadingError
from rigctl.units import show

#: a quantisation step of more sigmas than this hides the noise
_COARSE = 2.0
#: errors of sensors explain what is left if the error falls below this share
_FALLEN = 0.8


@checks_argument_types
@one_thread()
def compare(
    runs: Sequence[Run],
    models: Sequence[Model],
    *,
    hold_out: str | None = None,
    only: str | None = None,
    refit: bool = True,
    excluded: Collection[str] = (),
    on_progress: OnProgress | None = None,
) -> Comparison:
    """Compare each model with the usable records of `runs`.

    Parameters
    ----------
    hold_out: a condition that selects the records to be held out of every fit, e.g. ``oil == 60 degC``.
    only: a condition that selects the records to be used; the noise is learned from all records.
    refit: fit each model's free parameters first, without changing its file; False leaves them unchanged.
    excluded: effects of the library that are not to be considered.
    on_progress: called with a description of the current step, for a progress line.

    Raises
    ------
    RigctlError
        the runs do not belong to the models' bench, there are fewer values than parameters, a model cannot
        be simulated, or there is no such effect to exclude.
    """
    if not runs or not models:
        raise RigctlError("a comparison needs a run and a model")
    require_known(excluded, models)
    report = on_progress or no_progress
    compared: list[ModelComparison] = []
    notes: list[Note] = []
    labels: tuple[str, ...] = ()
    choice = Choice()
    read: list[tuple[Model, Data]] = []
    for model in models:
        data = next((known for other, known in read if other.same_bench(model)), None)
        if data is None:
            data = read_runs(model, runs, hold_out=hold_out, only=only, on_progress=report)
            read.append((model, data))
        labels = tuple(data.measurements.records[k].label for k in data.held_out)
        choice = data.choice
        fitted = fit_to_data(model, data, refit=refit, on_progress=report)
        report(f"Locating the errors of {model.name}")
        compared.append(judge(fitted, model.name, excluded=excluded, on_progress=report))
        notes += data_notes(fitted)
    return Comparison(
        runs=tuple(run.id for run in runs),
        held_out=labels,
        models=tuple(compared),
        notes=tuple(dict.fromkeys(notes)),
        choice=choice,
    )


@one_thread()
def judge(
    fitted: FitResult,
    name: str,
    *,
    excluded: Collection[str] = (),
    sensors: bool = True,
    on_progress: OnProgress | None = None,
) -> ModelComparison:
    """Test a fitted model; where its errors lie is computed when it is first looked at.

    Parameters
    ----------
    excluded: effects of the library that are not to be considered.
    sensors: try whether errors of sensors explain what is left; in a search for effects that was done before.
    """
    compared = _tested(fitted, name, excluded, on_progress)
    return _with_sensors_in_question(compared, on_progress) if sensors else compared


def _tested(
    fitted: FitResult, name: str, excluded: Collection[str], on_progress: OnProgress | None
) -> ModelComparison:
    """The tests of a fitted model, with the errors of sensors that its fit has."""
    # The library's equations at the fitted values, every effect at its null: the outputs are those of the
    # fit, and the derivatives by the effects' parameters come from one simulation.
    library_problem = fitted.problem.rebuilt(fitted.at_end, library=True, progress=on_progress)
    ranges = data_ranges(fitted.at_end.family, fitted.problem.measurements)
    slopes = KnownSlopes() if fitted.problem.model.with_laws else None
    linearisation = linearise(
        fitted, library_problem, candidates(fitted.at_end, excluded, ranges), known=slopes
    )
    projected = project(linearisation)
    screening = screen(projected)
    # Tests in a noise that is larger than every error prove nothing, whatever they say: that noise is
    # refuted, and the fit and its tests are repeated with the white floor.
    tests = adequacy(projected, screening)
    if tests.below_noise:
        again = _without_refuted_noise(fitted)
        if again is not None:
            return _tested(again, name, excluded, on_progress)
    return ModelComparison(
        name=name,
        fit=fitted,
        adequacy=tests,
        linearisation=linearisation,
        projected=projected,
        screening=screening,
        whole=library_problem,
        located=LocatedError(name, fitted, projected, screening, tests),
        excluded=frozenset(excluded),
        slopes=slopes,
    )


def _with_sensors_in_question(compared: ModelComparison, on_progress: OnProgress | None) -> ModelComparison:
    """The comparison, beside the one in which sensors are exact where their errors make a difference.

    Where calibrations with errors of a stated kind are in the fit already, it is repeated without them. Where
    only an uncertainty is stated, sensors were exact: if the model does not agree, it is repeated with errors
    of each, and that comparison is the answer if they explain what was left within what is stated, or if no
    test rejects the model any more and only the noise is in question. If they do not, or would have to be
    larger, it is kept beside the other as `with_sensor_errors`.
    """
    fitted, tests = compared.fit, compared.adequacy
    uncertain = fitted.problem.measurements.possible_errors
    if uncertain and fitted.solution is not None and not (tests.adequate or tests.unusable):
        wrong = _if_sensors_may_be_wrong(compared, on_progress)
        if wrong is not None:
            if wrong.adequacy.agrees:
                return wrong
            if _open_with_sensors(compared, wrong):
                return replace(wrong, rejected_if_exact=compared.adequacy.p_value)
            compared = replace(compared, with_sensor_errors=wrong)
    if tests.sensors is not None and (tests.only_misread or (tests.sensors.matters and tests.agrees)):
        report = on_progress or no_progress
        report(f"Fitting {compared.name} as if every sensor were exact")
        with suppress(RigctlError):  # it cannot be simulated without these errors: nothing to compare with
            exact = _as_exact(compared, on_progress)
            if exact.adequacy.verdict is False:
                return replace(compared, exact=exact)
    return compared


def _if_sensors_may_be_wrong(
    compared: ModelComparison, on_progress: OnProgress | None
) -> ModelComparison | None:
    """The comparison in which every calibration with a stated uncertainty may be wrong.

    None if it agrees, but not because of its sensors. Calibrations of no stated kind count
    only here, with zero, gain and curvature: they are tried before something is said to be missing, at the
    cost of one fit, and not in every search and design. A model that lacks something pulls its sensors beyond
    what is stated, so that an error beyond it is an answer only where no effect explains as much.
    """
    name, measurements = compared.name, compared.fit.problem.measurements
    (on_progress or no_progress)(f"Fitting {name} as if sensors might be wrong")
    errors = (*measurements.reading_errors, *measurements.possible_errors)
    with suppress(RigctlError):  # it cannot be simulated with them, or without: nothing to compare with
        wrong = _tested(_with_reading_errors(compared.fit, errors), name, compared.excluded, on_progress)
        tests = wrong.adequacy
        if not (tests.agrees or tests.only_misread):
            return wrong
        if _by_sensors(compared, wrong):
            return replace(wrong, exact=_as_exact(compared, on_progress))
    return None


def _by_sensors(exact: ModelComparison, wrong: ModelComparison) -> bool:
    """Whether it is the errors of sensors that make the model agree, and not another end of the fit."""
    sensors = wrong.adequacy.sensors
    if sensors is None:
        return False
    if sensors.matters or not exact.adequacy.unproven:
        return sensors.matters
    # the noise of channels in the scale of their own errors is too large to show it: these have to fall
    return all(
        wrong.fit.errors[name].rmse < _FALLEN * exact.fit.errors[name].rmse
        for name in exact.adequacy.unproven
    )


def _open_with_sensors(exact: ModelComparison, wrong: ModelComparison) -> bool:
    """Whether exact sensors are what makes a test reject the model, while slow noise leaves it open.

    No effect is then searched with exact sensors: it would be named for what they may read wrongly. The
    errors of the channels in question have to fall, on the whole, as one fit may trade one for another.
    """
    tests = wrong.adequacy
    if exact.adequacy.verdict is not False or not tests.undecided or tests.unusable or tests.misread:
        return False
    names = {*exact.adequacy.unproven, *tests.unproven}
    falls = [math.log(wrong.fit.errors[name].rmse / exact.fit.errors[name].rmse) for name in names]
    return sum(falls) < len(falls) * math.log(_FALLEN)


def _as_exact(compared: ModelComparison, on_progress: OnProgress | None) -> ModelComparison:
    """The comparison in which every sensor is exact: itself, unless errors of a stated kind are in its fit.

    Raises
    ------
    RigctlError
        the model cannot be simulated without these errors.
    """
    if not compared.fit.problem.measurements.reading_errors:
        return compared
    return _tested(_with_reading_errors(compared.fit, ()), compared.name, compared.excluded, on_progress)


def _with_reading_errors(fitted: FitResult, errors: tuple[ReadingError, ...]) -> FitResult:
    """The model fitted again with these errors of its sensors."""
    problem = fitted.problem
    return fit_model(
        problem.model,
        replace(problem.measurements, reading_errors=errors, possible_errors=()),
        noise_in(fitted),
        fitted.held_out,
        refit=any(one.name in problem.model.fitted for one in problem.shared),
    )


def _without_refuted_noise(fitted: FitResult) -> FitResult | None:
    """The model fitted again with the white floor alone for noises that its errors refute; None without any.

    Any model with few parameters is an upper bound: errors smaller than an assumed noise show that too much
    was assumed.
    """
    noise = noise_in(fitted)
    refuted = [
        channel.name
        for channel in noise.model.channels
        if not channel.own_scale
        and channel.name in fitted.errors
        and fitted.errors[channel.name].nrmse <= BELOW_NOISE
    ]
    learned = floor_alone(noise, refuted, "the model leaves less than the noise that was assumed")
    if learned is None:
        return None
    again = fit_in_noise(fitted, learned)
    left = with_what_is_left(
        learned, again.problem.measurements, again.outputs, again.fitted, unknowns=again.unknowns
    )
    return again if left is None else fit_in_noise(again, left)


def data_notes(fitted: FitResult) -> list[Note]:
    """What should be known about the data and the fit before a verdict is trusted."""
    problem = fitted.problem
    spikes = [
        Note(
            f"{channel.masked} {'spike' if channel.masked == 1 else 'spikes'} of {channel.name} "
            f"{'was' if channel.masked == 1 else 'were'} masked: "
            f"{'it counts' if channel.masked == 1 else 'they count'} in no fit and no test",
            "spikes",
        )
        for channel in problem.noise.channels
        if channel.masked
    ]
    edges = [
        f"{channel.edges} {'reading' if channel.edges == 1 else 'readings'} of {channel.name} "
        f"{'lies' if channel.edges == 1 else 'lie'} on edges beside a switch that are shorter than the "
        f"sampling: {'it is' if channel.edges == 1 else 'they are'} dominated by timing error, and masked"
        for channel in problem.noise.channels
        if channel.edges
    ]
    guesses = [
        Note(
            f"the noise of {channel.name} is only guessed: no verdict that rests on it is more certain than "
            "that",
            "taken",
        )
        for channel in problem.noise.channels
        if channel.guessed and not problem.measurements.table
    ]
    units = dict(zip(problem.measurements.outputs, problem.measurements.units, strict=True))
    coarse = [
        f"{channel.name} is read in steps of {show(channel.step, units[channel.name], difference=True)}, "
        "coarser than its noise: these data show nothing finer than a step"
        for channel in problem.noise.channels
        if channel.step > _COARSE * channel.level
    ]
    silent = [f"{name} affects none of these readings and keeps its value" for name in fitted.silent]
    inputs = input_noise_notes(problem)
    noise = [Note(problem.noise.statement, "taken")] if problem.noise.statement else []
    return [
        *problem.measurements.notes,
        *as_notes((*inputs, *noise, *coarse, *spikes, *edges, *guesses, *silent)),
    ]
