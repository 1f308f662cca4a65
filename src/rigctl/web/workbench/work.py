"""The jobs of the workbench, each in a separate process: the commands, with curves in addition.

Every function is given the `Report` of `rigctl.web.jobs` and the request as plain values, and returns the
command's answer to ``--json`` with the data of the page's plots.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rigctl.report.signals import plain_name
from rigctl.web.jobs import Report

if TYPE_CHECKING:
    from rigctl.analysis.comparison_result import Comparison
    from rigctl.analysis.diagnosis_result import Diagnosis
    from rigctl.analysis.search.refit import RefittedSet
    from rigctl.dataset import Run
    from rigctl.design.result import DesignResult
    from rigctl.model import Model
    from rigctl.model.fit.problem import Problem

Floats = NDArray[np.float64]
WorkArguments = Mapping[str, Any]

#: points of a curve
_POINTS = 600
#: candidates that are drawn over the residual
_DRAWN = 4


def compare(report: Report, arguments: WorkArguments) -> dict[str, Any]:
    """The answer of ``rigctl compare``; for two versions of the model, also their residuals in a record."""
    comparison = _compared(report, arguments)
    if len(comparison.models) == 1:
        return comparison.document()
    names = [str(arguments["beside"]), str(arguments["model"])]
    return comparison.document() | {"names": names, "residuals": _residuals(comparison, names)}


def diagnose(report: Report, arguments: WorkArguments) -> dict[str, Any]:
    """The answer of ``rigctl diagnose``, with the candidates' curves and differences of similar ones."""
    from rigctl.analysis.diagnosis import diagnose_comparison
    from rigctl.analysis.fitting import require_free_parameters

    require_free_parameters(_model(arguments))
    compared = _compared(report, arguments)
    diagnosis = diagnose_comparison(
        compared.models[0], compared.runs, compared.held_out, compared.notes, on_progress=report
    )
    return diagnosis.document() | {
        "title": diagnosis.title,
        "signatures": _signatures(diagnosis),
        "alike": [_alike(diagnosis, names) for names in diagnosis.classes if len(names) > 1],
        "states": {"+".join(one.effects): _state(one) for one in diagnosis.trials},
        "titles": {name: plain_name(name) for name in _effect_names(diagnosis)},
    }


def design(report: Report, arguments: WorkArguments) -> dict[str, Any]:
    """The answer of ``rigctl design``, with the prediction of every rival for every record."""
    from rigctl.design.design import design_experiment

    result = design_experiment(
        _runs(arguments),
        _model(arguments),
        hold_out=arguments.get("hold_out") or None,
        only=arguments.get("only") or None,
        on_progress=report,
    )
    names = [one.name for one in result.rivals]
    return result.as_json() | {
        "predictions": [_predictions(result, number) for number in range(len(result.records))],
        "titles": {name: plain_name(name) for name in names},
    }


def discover(report: Report, arguments: WorkArguments) -> dict[str, Any]:
    """The answer of ``rigctl discover``."""
    from rigctl.discovery.discover import discover as discovered

    discovery = discovered(
        _runs(arguments),
        _model(arguments),
        hold_out=arguments.get("hold_out") or None,
        only=arguments.get("only") or None,
        on_progress=report,
    )
    return discovery.document()


def fit(report: Report, arguments: WorkArguments) -> dict[str, Any]:
    """The answer of ``rigctl model fit``."""
    return _changed(report, arguments, "fit")


def add(report: Report, arguments: WorkArguments) -> dict[str, Any]:
    """The answer of ``rigctl model add M EFFECT --fit RUN``."""
    return _changed(report, arguments, "add")


def remove(report: Report, arguments: WorkArguments) -> dict[str, Any]:
    """The answer of ``rigctl model remove M EFFECT --fit RUN``."""
    return _changed(report, arguments, "remove")


def improve(report: Report, arguments: WorkArguments) -> dict[str, Any]:
    """The answer of ``rigctl diagnose --apply``."""
    from rigctl.analysis.fitting import require_free_parameters
    from rigctl.analysis.improve import improve as improved
    from rigctl.project import own_model

    path = own_model(Path(str(arguments["model"])))
    require_free_parameters(_model(arguments))
    return improved(_compared(report, arguments), path, on_progress=report).document()


def approve(report: Report, arguments: WorkArguments) -> dict[str, Any]:
    """Write the designed procedure, and carry it out on the simulated bench: ``rigctl simulate FILE``."""
    from rigctl.files.write import write_new
    from rigctl.runner.simulation import simulate

    path = Path(str(arguments["file"]))
    path.parent.mkdir(parents=True, exist_ok=True)
    write_new(path, str(arguments["procedure"]).encode("utf-8"))
    report("Carrying it out on the simulated bench")
    done = simulate(path, effects=tuple(arguments.get("effects") or ()), seed=arguments.get("seed"))
    return {"run": done.run.id, "status": done.result.status, "procedure": path.as_posix()}


def bring_in(report: Report, arguments: WorkArguments) -> dict[str, Any]:
    """The answer of ``rigctl import FILE``."""
    from rigctl.dataset.assumptions import read_assumptions
    from rigctl.dataset.importing import import_files
    from rigctl.dataset.importing.log_format import with_log_format
    from rigctl.dataset.importing.options import Options
    from rigctl.project import find_file, find_project
    from rigctl.rig import load_rig

    bench = load_rig(find_file(Path(str(arguments["rig"])))) if arguments.get("rig") else None
    options = with_log_format(Options(assume=read_assumptions(arguments.get("assume") or ())), bench)
    report("Reading the file")
    done = import_files([Path(str(arguments["file"]))], bench, find_project().runs, options)
    return {"run": done.run, "records": done.records, "rows": done.rows, "notes": list(done.notes)}


def _changed(report: Report, arguments: WorkArguments, kind: str) -> dict[str, Any]:
    from rigctl.analysis.search.model_change import Wanted, change_model
    from rigctl.project import own_model

    path = own_model(Path(str(arguments["model"])))
    effect = str(arguments.get("effect") or "")

    def change(model: Model) -> Model:
        if kind == "add":
            return model.with_effect(effect, {})
        return model.without_effect(effect) if kind == "remove" else model

    wanted = Wanted(
        kind,  # type: ignore[arg-type]
        change,
        True,
        arguments.get("hold_out") or None,
        arguments.get("only") or None,
        tuple(arguments.get("assume") or ()),
        effect=effect,
    )
    return change_model(path, wanted, _runs(arguments), on_progress=report).document()


def _model(arguments: WorkArguments) -> Model:
    from rigctl.model import load_model
    from rigctl.project import find_file

    return load_model(find_file(Path(str(arguments["model"]))))


def _runs(arguments: WorkArguments) -> list[Run]:
    from rigctl.dataset import open_run
    from rigctl.model.measured.assumed import assuming

    runs = list({run.id: run for run in map(open_run, arguments["runs"])}.values())
    assume = tuple(arguments.get("assume") or ())
    if not assume:
        return runs
    model = _model(arguments)
    return [assuming(run, model, assume) for run in runs]


def _compared(report: Report, arguments: WorkArguments) -> Comparison:
    from rigctl.analysis.comparison import compare as compared

    other = str(arguments.get("beside") or "")
    models = [*([_model({"model": other})] if other else []), _model(arguments)]
    return compared(
        _runs(arguments),
        models,
        hold_out=arguments.get("hold_out") or None,
        only=arguments.get("only") or None,
        on_progress=report,
    )


def _effect_names(diagnosis: Diagnosis) -> list[str]:
    names = [one.effect for one in diagnosis.ranking]
    names += [name for group in diagnosis.classes for name in group]
    return list(dict.fromkeys(names))


def _state(trial: RefittedSet) -> dict[str, Any]:
    """A refitted set as the sliders can show it: its effects, and every value that was fitted, SI."""
    model = trial.fit.at_end
    return {"on": list(trial.effects), "values": {name: model.values[name] for name in model.fitted}}


def _signatures(diagnosis: Diagnosis) -> dict[str, Any] | None:
    """The change by each refitted candidate, over the residual of the worst record."""
    from rigctl.report.analysis.overlay import typical_records

    best = [diagnosis.best] if diagnosis.best.candidates else []
    singles = sorted((one for one in diagnosis.trials if one.candidates), key=lambda one: one.chi2)
    trials = list({one.effects: one for one in (*best, *singles)}.values())[:_DRAWN]
    if not trials or diagnosis.before.rows:
        return None
    before = diagnosis.before.fit
    k = typical_records(before)[0][1]
    curves = {
        " and ".join(map(plain_name, one.effects)): (one.fit.outputs[k] - before.outputs[k])
        / before.problem.sigma[k]
        for one in trials
    }
    return _curves(before.problem, k, {"measured − model": -before.normalised_error(k), **curves})


def _residuals(comparison: Comparison, names: Sequence[str]) -> dict[str, Any] | None:
    """The residuals of two versions in the record in which they differ most, in sigmas."""
    fits = [model.fit for model in comparison.models]
    problem = fits[-1].problem
    if problem.measurements.table:
        return None
    errors = [[-fit.normalised_error(k) for k in range(len(fit.outputs))] for fit in fits]
    moved = [float(np.nanmean((old - new) ** 2)) for old, new in zip(*errors, strict=True)]
    k = int(np.argmax(moved))
    return _curves(problem, k, {name: each[k] for name, each in zip(names, errors, strict=True)})


def _alike(diagnosis: Diagnosis, names: Sequence[str]) -> dict[str, Any]:
    """A group that the data cannot distinguish, and the members less the first where they differ most."""
    trials = {one.effects: one for one in diagnosis.trials}
    present = [name for name in names if (name,) in trials]
    drawn = None
    if len(present) > 1 and not diagnosis.before.rows:
        sigma = diagnosis.before.fit.problem.sigma
        first = trials[(present[0],)].fit
        apart = {
            name: [(trials[(name,)].fit.outputs[k] - first.outputs[k]) / sigma[k] for k in range(len(sigma))]
            for name in present[1:]
        }
        k = max(
            range(len(sigma)), key=lambda at: max(float(np.abs(each[at]).max()) for each in apart.values())
        )
        named = {f"{plain_name(name)} − {plain_name(present[0])}": each[k] for name, each in apart.items()}
        drawn = _curves(diagnosis.before.fit.problem, k, named)
    return {"names": list(names), "titles": [plain_name(name) for name in names], "difference": drawn}


def _curves(problem: Problem, k: int, named: Mapping[str, Floats]) -> dict[str, Any]:
    """Curves of one record in sigmas, by channel."""
    record = problem.records[k]
    every = max(1, -(-record.times.size // _POINTS))
    at = slice(None, None, every)
    return {
        "record": record.label,
        "index": k,
        "times": _numbers(record.times[at]),
        "channels": [
            {
                "name": name,
                "title": plain_name(name),
                "curves": {label: _numbers(values[at, c]) for label, values in named.items()},
            }
            for c, name in enumerate(problem.measurements.outputs)
        ],
    }


def _predictions(result: DesignResult, number: int) -> list[dict[str, Any]]:
    """The predictions of the rivals for a proposed record, by channel, in the channel's unit."""
    from rigctl.answers.numbers import symbol

    drawn = []
    for one in result.records[number].predictions:
        at = slice(None, None, max(1, -(-one.times.size // _POINTS)))
        drawn.append(
            {
                "channel": plain_name(one.channel),
                "unit": symbol(one.unit),
                "times": _numbers(one.times[at]),
                "by_rival": {name: _numbers(values[at]) for name, values in one.by_rival.items()},
                "sigma": _numbers(one.sigma[at]),
            }
        )
    return drawn


def _numbers(values: Floats) -> list[float | None]:
    """Five digits, more than a screen shows; null for missing values."""
    return [float(f"{value:.5g}") if np.isfinite(value) else None for value in values]
