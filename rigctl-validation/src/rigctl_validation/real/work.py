"""One real log from its file to an improved model, by the steps that the how-to pages describe."""

from __future__ import annotations

import math
import shutil
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TypeAlias

from rigctl.analysis.comparison import compare
from rigctl.analysis.fitting import Data, fit_to_data, read_runs
from rigctl.analysis.improve import improve
from rigctl.dataset import Run, open_run
from rigctl.dataset.importing.bring_in import import_file
from rigctl.engine.one_thread import one_thread
from rigctl.engine.result_cache import switched_off
from rigctl.errors import RigctlError
from rigctl.model.load import load_model
from rigctl.model.model import Model
from rigctl.rig.load import load_rig
from rigctl.units import parse_unit
from rigctl_validation.benches.bench import USER_FILES
from rigctl_validation.moving.work import answer_of
from rigctl_validation.outcome import Improved, TrialOutcome
from rigctl_validation.real.logs import RealLog, data_folder, find_log
from rigctl_validation.real.tables import training_lines, unseen_lines, write_lines
from rigctl_validation.real.trial import RealTrial

RealOutcome: TypeAlias = TrialOutcome[RealTrial]


@one_thread()
@switched_off()
def carry_out_real(trial: RealTrial) -> RealOutcome:
    """Import a log, compare and diagnose its user's model, add what is missing, and simulate what is unseen.

    Raises
    ------
    RigctlError
        there is no folder of logs, or the tool cannot import or diagnose one.
    """
    began = time.process_time()
    log, data = find_log(trial.log), data_folder()
    with TemporaryDirectory() as name:
        folder = Path(name)
        run = _imported(log, training_lines(log, data), folder, "log", trial.rows)
        model = folder / "model.yaml"
        compared = compare([run], [load_model(model)])
        given = compared.models[0]
        improvement = improve(compared, model)
        diagnosis = improvement.steps[0].diagnosis if improvement.steps else improvement.last
        unseen = unseen_lines(log, data)
        parts = {
            part: _imported(log, lines, folder, f"unseen-{k}")
            for k, (part, lines) in enumerate(unseen.items())
        }
        if log.fit:
            parts = dict.fromkeys(log.known, run)
        after = load_model(model) if improvement.steps else given.fit.model
        errors = _errors([given.fit.model, after], parts, log)
        improved = Improved(
            added=tuple(effect for step in improvement.steps for effect in step.effects),
            r2={channel: shown["r2"] for channel, shown in given.channels().items()},
            before=errors[0],
            after=errors[1],
            last=answer_of(improvement.last),
            parameters=len(after.fitted),
        )
    return replace(
        TrialOutcome(trial),
        verdict=answer_of(diagnosis),
        effects=diagnosis.effects,
        classes=diagnosis.classes,
        first=diagnosis.ranking[0].effect if diagnosis.ranking else None,
        improved=improved,
        seconds=time.process_time() - began,
    )


def _imported(log: RealLog, lines: list[str], folder: Path, name: str, rows: int = 0) -> Run:
    """The run of a log that is imported into the folder, with its user's files."""
    for each in USER_FILES:
        if not (folder / each).exists():
            shutil.copyfile(log.file(each), folder / each)
    path = folder / f"{name}.csv"
    write_lines(path, lines, rows)
    return open_run(import_file(path, load_rig(folder / "rig.yaml"), folder / "runs").path)


def _errors(models: Sequence[Model], parts: Mapping[str, Run], log: RealLog) -> list[dict[str, float]]:
    """For each model, RMSE of a simulation of each part; only its start and the logger's delay are fitted."""
    errors: list[dict[str, float]] = [{} for _ in models]
    for part, run in parts.items():
        data = read_runs(models[0], [run])  # once: the noise of a long record takes longer than a simulation
        for k, model in enumerate(models):
            errors[k][part] = _error(model, data, log)
    return errors


def _error(model: Model, data: Data, log: RealLog) -> float:
    """RMSE in the log's unit; NaN if the model cannot be simulated."""
    try:
        simulated = fit_to_data(model, data, refit=False)
    except RigctlError:
        return math.nan
    return simulated.errors[log.channel].rmse / parse_unit(log.unit).factor
