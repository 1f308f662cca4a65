"""One trial from the generator to the verdict, by the steps that the how-to pages describe."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TypeAlias

from rigctl.analysis.diagnosis_result import Diagnosis
from rigctl.engine.one_thread import one_thread
from rigctl.engine.result_cache import switched_off
from rigctl.errors import RigctlError
from rigctl_validation.amplitude import CLOSE
from rigctl_validation.moving.intervals import intervals_of
from rigctl_validation.moving.spoiled import write_spoiled
from rigctl_validation.moving.trial import LEAST_LEFT, MovingTrial
from rigctl_validation.moving_benches.campaign import write_moving
from rigctl_validation.moving_benches.left_over import amplitude_leaving
from rigctl_validation.outcome import AnyTrial, TrialOutcome, Verdict
from rigctl_validation.user_folder import diagnose_log

MovingOutcome: TypeAlias = TrialOutcome[MovingTrial]


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
    amplitude, outcome = amplitude_of(trial, TrialOutcome(trial))
    if outcome.untested:
        return outcome
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
        intervals=() if trial.spoiled else tuple(intervals_of(trial.campaign, amplitude, diagnosis)),
        seconds=time.process_time() - began,
    )


def amplitude_of(trial: MovingTrial, outcome: TrialOutcome[AnyTrial]) -> tuple[float, TrialOutcome[AnyTrial]]:
    """The amplitude of the hidden effect, and `outcome` with it; `untested` if none leaves enough."""
    if not trial.hidden:
        return 0.0, outcome
    amplitude, left = amplitude_leaving(trial.campaign, trial.wanted)
    outcome = replace(outcome, amplitudes=(amplitude,), sizes=(left,))
    # an effect that cannot leave as much as drawn is taken at its largest
    if (1.0 - CLOSE) * LEAST_LEFT <= left <= (1.0 + CLOSE) * trial.wanted:
        return amplitude, outcome
    return amplitude, replace(outcome, untested="no amplitude has the size wanted")


def answer_of(diagnosis: Diagnosis) -> Verdict:
    """The verdict; `undecided` also where the answer says that these data cannot tell."""
    return "undecided" if diagnosis.doubt else diagnosis.verdict.value


def _diagnosis(trial: MovingTrial, amplitude: float, folder: Path) -> Diagnosis:
    campaign = trial.campaign
    if trial.spoiled:
        log = write_spoiled(campaign, trial.spoiled, folder)
    else:
        log = write_moving(campaign, [campaign.table(amplitude)], folder)
    return diagnose_log(log)
