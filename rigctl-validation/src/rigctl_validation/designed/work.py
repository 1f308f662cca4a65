"""One learning loop on the separate bench, from the first campaign to its end, with its predictions."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TypeAlias, cast

from rigctl.analysis.diagnosis_result import Diagnosis
from rigctl.dataset import Run
from rigctl.design.design import random_experiment
from rigctl.design.result import DesignResult
from rigctl.engine.one_thread import one_thread
from rigctl.engine.result_cache import switched_off
from rigctl.files.shipped import shipped
from rigctl.learning.learn import Learner
from rigctl.learning.learning_folder import LearningFolder, Task
from rigctl.learning.result import Learned, Round
from rigctl.model import Model
from rigctl_validation.designed.trial import PRESSURES, TEMPERATURES, DesignTrial
from rigctl_validation.live_bench import SeparateBench
from rigctl_validation.outcome import LearningOutcome, TrialOutcome, Verdict
from rigctl_validation.work import hidden_amplitudes

DesignOutcome: TypeAlias = TrialOutcome[DesignTrial]


@one_thread()
def carry_out_design(trial: DesignTrial) -> DesignOutcome:
    """Hide, measure, diagnose, design, measure the designed records, and compare with the prediction.

    For a trial with records at random these are measured instead of designed ones, whatever their predicted
    power; fits to the same first campaign are reused.

    Raises
    ------
    RigctlError
        the tool cannot diagnose the campaign, or design for it.
    BenchFailure
        the bench cannot be simulated with its hidden effects.
    """
    began = time.process_time()
    scenario = trial.scenario
    amplitudes = hidden_amplitudes(scenario)
    outcome = TrialOutcome(
        trial,
        sizes=tuple(each.size for each in amplitudes),
        amplitudes=tuple(each.value for each in amplitudes),
    )
    if not all(each.reached for each in amplitudes):
        return replace(outcome, untested="no amplitude has the size wanted")
    with TemporaryDirectory() as folder, nullcontext() if trial.taken else switched_off():
        learned, designs = _learned(trial, outcome.amplitudes, Path(folder))
    first, last = learned.rounds[0], [one for one in learned.rounds if one.judged][-1]
    return replace(
        outcome,
        verdict=cast("Verdict", last.verdict),
        effects=(*learned.added, *(name for name in last.effects if name not in learned.added)),
        classes=tuple(names for one in learned.rounds for names in one.classes),
        first=first.effects[0] if first.effects else None,
        learnt=_learning_outcome(trial, learned, designs),
        seconds=time.process_time() - began,
    )


def _learned(
    trial: DesignTrial, amplitudes: tuple[float, ...], folder: Path
) -> tuple[Learned, list[DesignResult]]:
    """The learning loop, and each round's design."""
    model = folder / "model.yaml"
    model.write_bytes(shipped("models", "hl32-textbook.yaml").read_bytes())
    runs = folder / "runs"
    runs.mkdir()
    task = Task(
        procedure=str(shipped("procedures", "campaign.yaml")),
        model=str(model),
        version=1,
        arguments={
            "temperatures": ", ".join(f"{value:g} degC" for value in TEMPERATURES),
            "pressures": ", ".join(f"{value:g} bar" for value in PRESSURES),
        },
        rounds=trial.rounds,
    )
    campaign = trial.scenario.campaign(amplitudes)
    bench = SeparateBench(campaign, shipped("rigs", "hl32-bench.yaml"), runs)
    designs: list[DesignResult] = []

    def yes(_: Round, design: DesignResult) -> bool:
        designs.append(design)
        return True

    learner = Learner(LearningFolder.create(folder, task, "design"), bench, runs, yes)
    if trial.taken:
        learner = replace(learner, designer=_at_random(trial), worth=0.0)
    return learner.learn(), designs


def _at_random(trial: DesignTrial) -> Callable[..., DesignResult]:
    """A designer that returns as many records at random points as the trial specifies."""

    def records(runs: Sequence[Run], model: Model, *, diagnosis: Diagnosis, **_: object) -> DesignResult:
        return random_experiment(runs, diagnosis, records=trial.taken, seed=1000 * trial.seed + trial.draw)

    return records


def _learning_outcome(
    trial: DesignTrial, learned: Learned, designs: Sequence[DesignResult]
) -> LearningOutcome:
    first = learned.rounds[0]
    predicted, achieved = learned.predictions[0] if learned.predictions else (None, None)
    chances: dict[str, float] = {}
    apart: tuple[str, ...] = ()
    (truth, *more) = trial.hidden
    if predicted is not None and achieved is not None and not more:
        chances = {one["rival"]: one["probability"] for one in predicted.outlooks if one["truth"] == truth}
        (after,) = [one for one in learned.rounds if one.predicted is predicted]
        with_it = {name for names in after.classes if truth in names for name in names}
        apart = tuple(name for name in chances if truth in with_it and name not in with_it)
    return LearningOutcome(
        chances=chances,
        apart=apart,
        of_random=designs[0].of_random if designs else None,
        of_first=designs[0].records[0].separation if designs else None,
        sensor=learned.sensor,
        statement=learned.statement,
        ended=learned.ended.value,
        rounds=len([one for one in learned.rounds if one.judged]),
        added=learned.added,
        left=tuple(names for names in first.classes if len(names) > 1),
        probability=None if predicted is None else predicted.probability,
        separation=None if predicted is None else predicted.separation,
        winner="" if achieved is None else achieved.winner,
        told=achieved is not None and achieved.distinguished,
        kept=achieved is None or achieved.kept,
        gains={} if achieved is None else dict(achieved.gains),
        expected={} if achieved is None else dict(achieved.expected),
    )
