"""Scenarios in parallel, each result kept as soon as it is available."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeAlias

from rigctl.errors import RigctlError
from rigctl.tasks import Workers, map_tasks
from rigctl.tasks.countdown import duration_text
from rigctl_validation.outcome import AnyTrial, TrialOutcome
from rigctl_validation.store import ResultStore

#: maps a scenario to its outcome; sent to other processes, so a module's function or a partial of one
Work: TypeAlias = Callable[[AnyTrial], TrialOutcome[AnyTrial]]


@dataclass(frozen=True)
class BenchmarkProgress:
    """The progress: `done` and `failed` of `total` scenarios, s since the start and estimated s left."""

    done: int
    total: int
    failed: int
    elapsed: float
    left: float
    last: TrialOutcome[Any] | None = None

    def __str__(self) -> str:
        remaining = f", about {duration_text(self.left)} left" if math.isfinite(self.left) else ""
        failed = f", {self.failed} failed" if self.failed else ""
        return f"Trials: {self.done} of {self.total}{failed}, {duration_text(self.elapsed)} so far{remaining}"


def run_scenarios(
    scenarios: Sequence[AnyTrial],
    work: Work[AnyTrial],
    store: ResultStore[AnyTrial],
    *,
    workers: Workers | None = None,
    progress: Callable[[BenchmarkProgress], None] = lambda _: None,
) -> tuple[TrialOutcome[AnyTrial], ...]:
    """Carry out the scenarios without a result; returns the results of all of them.

    After an interruption it continues when called again. The work on one scenario may fail with a
    `RigctlError` or an arithmetic error: that is its outcome.

    Parameters
    ----------
    workers: by default one process on each core of this computer.
    progress: called after every scenario, and once at the start.

    Raises
    ------
    RigctlError
        a scenario kills its process again and again, the cluster is gone, or results cannot be kept.
    """
    missing = store.missing(scenarios)
    began, failed = time.monotonic(), 0
    done = len(scenarios) - len(missing)
    progress(BenchmarkProgress(done, len(scenarios), 0, 0.0, math.inf if missing else 0.0))
    for finished, (_, outcome) in enumerate(map_tasks(partial(attempt, work), missing, workers), start=1):
        store.keep(outcome)
        failed += bool(outcome.failure)
        elapsed = time.monotonic() - began
        remaining = elapsed / finished * (len(missing) - finished)
        progress(BenchmarkProgress(done + finished, len(scenarios), failed, elapsed, remaining, outcome))
    return store.outcomes(scenarios)


def attempt(work: Work[AnyTrial], scenario: AnyTrial) -> TrialOutcome[AnyTrial]:
    """The outcome of a scenario, which may be a failure."""
    began = time.process_time()
    try:
        return work(scenario)
    except (RigctlError, ArithmeticError, ValueError) as problem:
        message = f"{type(problem).__name__}: {problem}"
        return TrialOutcome(scenario, failure=message, seconds=time.process_time() - began)
