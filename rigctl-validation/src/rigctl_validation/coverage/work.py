"""One trial of coverage from the generator to the verdict and its intervals."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TypeAlias

from rigctl.analysis.diagnosis_result import Diagnosis
from rigctl.engine.one_thread import one_thread
from rigctl.engine.result_cache import switched_off
from rigctl_validation.coverage.trial import CoverageTrial
from rigctl_validation.moving.intervals import intervals_of
from rigctl_validation.moving.work import amplitude_of, answer_of
from rigctl_validation.moving_benches.campaign import write_moving
from rigctl_validation.outcome import TrialOutcome
from rigctl_validation.user_folder import diagnose_log

CoverageOutcome: TypeAlias = TrialOutcome[CoverageTrial]


@one_thread()
@switched_off()
def carry_out_coverage(trial: CoverageTrial) -> CoverageOutcome:
    """Measure the bench with wrong sensors, import the file and diagnose the model with its guess.

    Raises
    ------
    RigctlError
        the tool cannot import or diagnose the measurements.
    """
    began = time.process_time()
    amplitude, outcome = amplitude_of(trial.moving, TrialOutcome(trial))
    if outcome.untested:
        return outcome
    with TemporaryDirectory() as folder:
        diagnosis = _diagnosis(trial, amplitude, Path(folder))
    return replace(
        outcome,
        verdict=answer_of(diagnosis),
        effects=diagnosis.effects,
        classes=diagnosis.classes,
        first=diagnosis.ranking[0].effect if diagnosis.ranking else None,
        explained_by=diagnosis.before.explained_by or "",
        intervals=tuple(intervals_of(trial.moving.campaign, amplitude, diagnosis)),
        seconds=time.process_time() - began,
    )


def _diagnosis(trial: CoverageTrial, amplitude: float, folder: Path) -> Diagnosis:
    campaign, misread = trial.moving.campaign, trial.misread
    log = write_moving(campaign, [misread.read(campaign.table(amplitude))], folder)
    misread.state(folder)
    return diagnose_log(log)
