"""Scenarios in several processes, each result kept as soon as it is there."""

from __future__ import annotations

import math
import os
import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import get_context, parent_process
from typing import Any, TypeAlias

from rigctl.errors import RigctlError
from rigctl.validation.outcome import AnyTrial, TrialOutcome
from rigctl.validation.store import ResultStore

#: a scenario in, what came of it out; sent to other processes, so a module's function or a partial of one
Work: TypeAlias = Callable[[AnyTrial], TrialOutcome[AnyTrial]]

#: libraries that would use every core in each process
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


@dataclass(frozen=True)
class Standing:
    """How far it has come: `done` and `failed` of `total` scenarios, s since the start and s left."""

    done: int
    total: int
    failed: int
    elapsed: float
    left: float
    last: TrialOutcome[Any] | None = None

    def __str__(self) -> str:
        left = f", about {_duration(self.left)} left" if math.isfinite(self.left) else ""
        failed = f", {self.failed} failed" if self.failed else ""
        return f"{self.done} of {self.total}{failed}, {_duration(self.elapsed)} so far{left}"


def run_scenarios(
    scenarios: Sequence[AnyTrial],
    work: Work[AnyTrial],
    store: ResultStore[AnyTrial],
    *,
    workers: int | None = None,
    progress: Callable[[Standing], None] = lambda _: None,
) -> tuple[TrialOutcome[AnyTrial], ...]:
    """Carry out the scenarios that have no result yet; returns the results of all of them.

    Interrupted or killed, it goes on where it was when it is called again. The work of one scenario may fail
    with a `RigctlError` or an arithmetic one: that is its outcome.

    Parameters
    ----------
    workers: processes, one for each core unless told otherwise; with 1 the work is done in this process.
    progress: told after every scenario, and once at the start.

    Raises
    ------
    RigctlError
        a process was killed, or results cannot be kept.
    """
    missing = store.missing(scenarios)
    began, failed = time.monotonic(), 0
    done = len(scenarios) - len(missing)
    progress(Standing(done, len(scenarios), 0, 0.0, math.inf if missing else 0.0))
    count = min(workers or os.cpu_count() or 1, max(len(missing), 1))
    for finished, outcome in enumerate(_outcomes(missing, work, count), start=1):
        store.keep(outcome)
        failed += bool(outcome.failure)
        elapsed = time.monotonic() - began
        left = elapsed / finished * (len(missing) - finished)
        progress(Standing(done + finished, len(scenarios), failed, elapsed, left, outcome))
    return store.outcomes(scenarios)


def attempt(work: Work[AnyTrial], scenario: AnyTrial) -> TrialOutcome[AnyTrial]:
    """What `work` makes of a scenario; its failure is an outcome too."""
    began = time.process_time()
    try:
        return work(scenario)
    except (RigctlError, ArithmeticError, ValueError) as problem:
        said = f"{type(problem).__name__}: {problem}"
        return TrialOutcome(scenario, failure=said, seconds=time.process_time() - began)


def _outcomes(
    scenarios: Sequence[AnyTrial], work: Work[AnyTrial], workers: int
) -> Iterator[TrialOutcome[AnyTrial]]:
    if workers == 1:
        for scenario in scenarios:
            yield attempt(work, scenario)
        return
    with _one_thread_each():
        pool = ProcessPoolExecutor(workers, mp_context=get_context("spawn"), initializer=begin_worker)
        try:
            yield from _finished(pool, scenarios, work, workers)
        except BrokenProcessPool as problem:
            raise RigctlError(
                "a process of the benchmark was killed; the results so far are kept",
                hint="'--resume' goes on where it was (fewer '--workers', if memory is short)",
            ) from problem
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def _finished(
    pool: ProcessPoolExecutor, scenarios: Iterable[AnyTrial], work: Work[AnyTrial], workers: int
) -> Iterator[TrialOutcome[AnyTrial]]:
    """Outcomes as they come; few are handed out ahead, so that an interrupt is soon obeyed."""
    waiting = iter(scenarios)
    running: set[Future[TrialOutcome[AnyTrial]]] = set()
    while True:
        while len(running) < 2 * workers and (scenario := next(waiting, None)) is not None:
            running.add(pool.submit(attempt, work, scenario))
        if not running:
            return
        ready, running = wait(running, return_when=FIRST_COMPLETED)
        for future in ready:
            yield future.result()


def begin_worker() -> None:
    """Let this process end with the one that started it, and by Ctrl-C at once: the other one tells of it."""
    signal.signal(signal.SIGINT, lambda *_: os._exit(1))
    end_with_parent()


def end_with_parent() -> None:
    """Let this process end as soon as the one that started it has: killed, that one could not tell it."""
    parent = parent_process()

    def watch() -> None:
        if parent is not None:
            parent.join()
            os._exit(1)  # no clean-up: it would wait for work that nobody wants any more

    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """The environment that new processes inherit: one thread in each, unless the user has set it."""
    added = {name: "1" for name in _THREADS if name not in os.environ}
    os.environ.update(added)
    try:
        yield
    finally:
        for name in added:
            os.environ.pop(name, None)


def _duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return (
        f"{hours} h {minutes:02d} min" if hours else f"{minutes} min {rest:02d} s" if minutes else f"{rest} s"
    )
