"""Compare models with measurements: how well they agree, and where they fail."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

from rigctl.analysis.adequacy import Adequacy, adequacy, chance_text
from rigctl.analysis.candidates import candidates, data_ranges
from rigctl.analysis.comparison_result import Choice, Comparison, ModelComparison
from rigctl.analysis.fitting import Data, OnProgress, fit_to_data, no_progress, read_runs
from rigctl.analysis.linearisation import linearise
from rigctl.analysis.localisation import Place, cell_map, localise, worst_stretches
from rigctl.analysis.nuisance_projection import project
from rigctl.analysis.record_level import RecordQuantity, record_level
from rigctl.analysis.score_test import screen
from rigctl.analysis.single_values.rows import table_rows
from rigctl.analysis.single_values.statements import table_findings, table_statement
from rigctl.analysis.slot_evidence import slot_evidence
from rigctl.analysis.trends import sentence, trends
from rigctl.dataset.run import Run
from rigctl.engine.one_thread import one_thread
from rigctl.errors import RigctlError
from rigctl.model.curve_bands import curve_bands
from rigctl.model.fit.fit import FitResult
from rigctl.model.fit.input_noise import input_noise_notes
from rigctl.model.model import Model
from rigctl.model.validity import departures
from rigctl.units import show

#: a quantisation step of more sigmas than this hides the noise
_COARSE = 2.0


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
        the runs do not belong to the models' bench, there are fewer values than parameters, or a model cannot
        be simulated.
    """
    if not runs or not models:
        raise RigctlError("a comparison needs a run and a model")
    said = on_progress or no_progress
    compared: list[ModelComparison] = []
    notes: list[str] = []
    labels: tuple[str, ...] = ()
    choice = Choice()
    read: dict[tuple[str, str], Data] = {}
    for model in models:
        key = (model.family.name, model.rig.name if model.rig else "")
        if key not in read:
            read[key] = read_runs(model, runs, hold_out=hold_out, only=only, on_progress=said)
        data = read[key]
        labels = tuple(data.measurements.records[k].label for k in data.held_out)
        choice = data.choice
        fitted = fit_to_data(model, data, refit=refit, on_progress=said)
        said(f"Locating the errors of {model.name}")
        compared.append(judge(fitted, model.name, excluded=excluded, on_progress=said))
        notes += data_notes(fitted)
    return Comparison(
        runs=tuple(run.id for run in runs),
        held_out=labels,
        models=tuple(compared),
        notes=tuple(note for note in dict.fromkeys(notes) if note),
        choice=choice,
    )


@one_thread()
def judge(
    fitted: FitResult,
    name: str,
    *,
    excluded: Collection[str] = (),
    locate: bool = True,
    on_progress: OnProgress | None = None,
) -> ModelComparison:
    """Test a fitted model, and locate its errors.

    Parameters
    ----------
    excluded: effects of the library that are not to be considered.
    locate: False leaves out the locations of the error, its trends and the equations, and only tests.
    """
    whole = fitted.problem.rebuilt(fitted.model, library=True, progress=on_progress)
    ranges = data_ranges(fitted.model.family, fitted.problem.measurements)
    linearisation = linearise(fitted, whole, candidates(fitted.model, excluded, ranges))
    projected = project(linearisation)
    screening = screen(projected)
    tests = adequacy(projected, screening)
    judged = ModelComparison(
        name=name,
        fit=fitted,
        adequacy=tests,
        where=(),
        trends=(),
        slots=(),
        statement=_statement(name, tests, (), ""),
        linearisation=linearisation,
        projected=projected,
        screening=screening,
        cells=cell_map(projected),
        whole=whole,
        excluded=frozenset(excluded),
    )
    return _located(judged) if locate else judged


def _located(judged: ModelComparison) -> ModelComparison:
    """With the locations of the error, its trends, the equations and, for a table, its rows."""
    fitted, tests = judged.fit, judged.adequacy
    where = (*localise(judged.linearisation, judged.cells), *worst_stretches(fitted))
    directions, slots, rows = trends(fitted), slot_evidence(fitted), table_rows(fitted)
    quantities = () if rows else record_level(fitted)
    direction = sentence(directions)
    return replace(
        judged,
        where=where,
        trends=directions,
        slots=slots,
        statement=table_statement(judged.name, tests, rows, direction)
        if rows
        else _statement(judged.name, tests, where, direction, quantities),
        rows=rows,
        findings=table_findings(judged.linearisation, tests, judged.screening, rows) if rows else (),
        record_level=quantities,
        outside=departures(fitted),
        curve_bands=curve_bands(fitted),
    )


def _statement(
    name: str,
    tests: Adequacy,
    where: Sequence[Place],
    direction: str,
    quantities: Sequence[RecordQuantity] = (),
) -> str:
    adequate, p = tests.adequate, tests.p_value
    if tests.below_noise:
        return (
            f"{name} is nearer to the measurements than their noise: a test sees a pattern in the residuals "
            f"({chance_text(p)}), but the noise of these readings is not as learned, so they cannot decide"
        )
    suspicious = next((quantity.statement for quantity in quantities if quantity.statement), "")
    if adequate and suspicious:
        return f"{name} agrees with the measurements within their noise (p = {p:.2g}), but {suspicious}"
    if adequate:
        return (
            f"{name} agrees with the measurements within their noise (p = {p:.2g}): "
            "these data show nothing that it lacks"
        )
    cells = [index for index in where if index.by == "cell"]
    text = f"{name} does not agree with the measurements ({chance_text(p)})"
    if cells:
        worst = cells[0]
        text += f": {100 * worst.share_of_error:.0f} % of the systematic error is in {worst.label}"
    return f"{text}. {direction}" if direction else text


def data_notes(fitted: FitResult) -> list[str]:
    """What should be known about the data and the fit before a verdict is trusted."""
    problem = fitted.problem
    spikes = [
        f"{channel.masked} {'spike' if channel.masked == 1 else 'spikes'} of {channel.name} "
        f"{'was' if channel.masked == 1 else 'were'} masked: "
        f"{'it counts' if channel.masked == 1 else 'they count'} in no fit and no test"
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
        f"the noise of {channel.name} is only guessed: no verdict that rests on it is more certain than that"
        for channel in problem.noise.channels
        if channel.guessed and not problem.measurements.table
    ]
    units = dict(zip(problem.measurements.outputs, problem.measurements.units, strict=True))
    coarse = [
        f"{channel.name} is read in steps of {show(channel.step, units[channel.name], difference=True)}, "
        "coarser than its noise: these data show nothing finer than a step"
        for channel in problem.noise.channels
        if channel.step > _COARSE * channel.sigma
    ]
    silent = [f"{name} affects none of these readings and keeps its value" for name in fitted.silent]
    inputs = input_noise_notes(problem)
    noise = [problem.noise.statement, *coarse, *spikes, *edges, *guesses]
    return [*problem.measurements.notes, *inputs, *noise, *silent]
