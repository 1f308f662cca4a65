"""One trial from the generator to the verdict, by the steps that the how-to pages describe."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TypeAlias

from rigctl.analysis.diagnosis_result import Diagnosis
from rigctl.engine.one_thread import one_thread
from rigctl.engine.result_cache import switched_off
from rigctl_validation.amplitude import CLOSE, search_amplitude
from rigctl_validation.benches.bench import BenchCampaign, write_bench
from rigctl_validation.benches.register import find_bench
from rigctl_validation.benches.size import size_of
from rigctl_validation.outcome import TrialOutcome
from rigctl_validation.small_benches.trial import BenchTrial
from rigctl_validation.user_folder import diagnose_log

BenchOutcome: TypeAlias = TrialOutcome[BenchTrial]


@one_thread()
@switched_off()
def carry_out_trial(trial: BenchTrial) -> BenchOutcome:
    """Measure the bench of a trial, import the file, diagnose the user's model, and return the outcome.

    Raises
    ------
    RigctlError
        the tool cannot import or diagnose the measurements.
    """
    began = time.process_time()
    amplitude, size = amplitude_of(trial) if trial.size else (0.0, 0.0)
    outcome = (
        TrialOutcome(trial, amplitudes=(amplitude,), sizes=(size,)) if trial.size else TrialOutcome(trial)
    )
    if trial.size and abs(size / trial.size - 1.0) > CLOSE:
        return replace(outcome, untested="no amplitude has the size wanted")
    with TemporaryDirectory() as folder:
        diagnosis = diagnose_campaign(trial.campaign(amplitude), Path(folder))
    return replace(
        outcome,
        verdict=diagnosis.verdict.value,
        effects=diagnosis.effects,
        classes=diagnosis.classes,
        first=diagnosis.ranking[0].effect if diagnosis.ranking else None,
        seconds=time.process_time() - began,
    )


def diagnose_campaign(campaign: BenchCampaign, folder: Path) -> Diagnosis:
    """The diagnosis of a campaign that is imported into `folder`."""
    return diagnose_log(write_bench(campaign, folder))


def amplitude_of(trial: BenchTrial) -> tuple[float, float]:
    """The amplitude with the wanted λ, and that λ; of the first seed, and approximately of all."""
    return _amplitude(trial.bench, trial.size, trial.sampling, trial.recorded)


@lru_cache(maxsize=512)
def _amplitude(name: str, wanted: float, sampling: str, recorded: bool) -> tuple[float, float]:
    hidden = find_bench(name).hidden
    plain = BenchTrial(name, wanted, sampling, recorded)  # type: ignore[arg-type]
    tried: list[tuple[float, float]] = []

    def size(amplitude: float) -> float:
        result = size_of(plain.campaign(amplitude))
        tried.append((amplitude, result))
        return result if math.isfinite(result) else math.inf

    return search_amplitude(size, wanted, hidden.typical, hidden.largest, tried)
