"""One trial from the generator to the verdict, by the steps that the how-to pages describe."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TypeAlias

from rigctl.analysis.diagnosis import diagnose
from rigctl.analysis.diagnosis_result import Diagnosis
from rigctl.dataset import open_run
from rigctl.dataset.importing.bring_in import import_file
from rigctl.engine.one_thread import one_thread
from rigctl.engine.result_cache import switched_off
from rigctl.errors import RigctlError
from rigctl.model.load import load_model
from rigctl.rig.load import load_rig
from rigctl.units import parse_unit
from rigctl.validation.amplitude import CLOSE
from rigctl.validation.moving.spoiled import write_spoiled
from rigctl.validation.moving.trial import LEAST_LEFT, MovingTrial
from rigctl.validation.moving_benches.campaign import write_moving
from rigctl.validation.moving_benches.left_over import amplitude_leaving
from rigctl.validation.outcome import Interval, TrialOutcome, Verdict

MovingOutcome: TypeAlias = TrialOutcome[MovingTrial]

#: half of a 95 % interval, in standard deviations
_HALF = 1.959963984540054


@one_thread()
@switched_off()
def carry_out_moving(trial: MovingTrial) -> MovingOutcome:
    """Measure the bench of a trial, import the file, diagnose the user's model, and return the outcome.

    Raises
    ------
    RigctlError
        the tool cannot import or diagnose measurements that are not spoiled.
    """
    began = time.process_time()
    amplitude, left = amplitude_leaving(trial.campaign, trial.wanted) if trial.hidden else (0.0, 0.0)
    outcome = TrialOutcome(trial)
    if trial.hidden:
        outcome = replace(outcome, amplitudes=(amplitude,), sizes=(left,))
        # an effect that cannot leave as much as drawn is taken at its largest
        if not (1.0 - CLOSE) * LEAST_LEFT <= left <= (1.0 + CLOSE) * trial.wanted:
            return replace(outcome, untested="no amplitude has the size wanted")
    with TemporaryDirectory() as folder:
        try:
            diagnosis = _diagnosis(trial, amplitude, Path(folder))
        except RigctlError:
            if not trial.spoiled:
                raise
            return replace(outcome, verdict="refused", seconds=time.process_time() - began)
    return replace(
        outcome,
        verdict=answer_of(diagnosis),
        effects=diagnosis.effects,
        classes=diagnosis.classes,
        first=diagnosis.ranking[0].effect if diagnosis.ranking else None,
        intervals=tuple(_intervals(trial, amplitude, diagnosis)),
        seconds=time.process_time() - began,
    )


def answer_of(diagnosis: Diagnosis) -> Verdict:
    """The verdict; `undecided` also where the answer says that these data cannot tell."""
    return "undecided" if diagnosis.doubt else diagnosis.verdict.value


def _diagnosis(trial: MovingTrial, amplitude: float, folder: Path) -> Diagnosis:
    campaign = trial.campaign
    if trial.spoiled:
        log = write_spoiled(campaign, trial.spoiled, folder)
    else:
        log = write_moving(campaign, [campaign.table(amplitude)], folder)
    imported = import_file(log, load_rig(folder / "rig.yaml"), folder / "runs")
    return diagnose([open_run(imported.path)], load_model(folder / "model.yaml"))


def _intervals(trial: MovingTrial, amplitude: float, diagnosis: Diagnosis) -> Iterator[Interval]:
    """The 95 % intervals with known true values: of a hidden effect's size, else of the bench's values."""
    campaign = trial.campaign
    if trial.spoiled:
        return
    if not trial.hidden:
        fit = diagnosis.before.fit
        truths = {
            each.parameter: each.si * float(value)
            for each, value in zip(campaign.twin.drawn, campaign.drawn, strict=True)
        }
        for unknown, value in zip(fit.problem.shared, fit.values, strict=True):
            std = fit.std.get(unknown.name, 0.0)
            if unknown.name in truths and std > 0.0 and math.isfinite(std):
                yield _interval("", unknown.name, truths[unknown.name], float(value), std)
        return
    hidden = campaign.hidden
    if hidden is None or hidden.exact is None or hidden.exact[0] not in diagnosis.effects:
        return
    effect, parameter = hidden.exact
    found = next((one.parameters.get(parameter) for one in diagnosis.ranking if one.effect == effect), None)
    if found is not None and found.std > 0.0 and math.isfinite(found.std):
        factor = parse_unit(found.unit).factor
        truth = hidden.truth(amplitude, campaign.drawn)
        yield _interval(effect, parameter, truth, factor * found.value, factor * found.std)


def _interval(effect: str, parameter: str, truth: float, value: float, std: float) -> Interval:
    return Interval(effect, parameter, truth, value - _HALF * std, value + _HALF * std)
