"""Execution of tasks in threads or processes of this computer.

In: a function and its pieces of work. Out: results in order of completion. Threads are for work that
releases the interpreter's lock, processes for everything else.

Processes are started afresh (`spawn`), on all systems alike, with one thread each for the libraries of
linear algebra, which otherwise would take every core in each of them. When one is killed, nobody knows by
which piece: all that were running are repeated one at a time, and only a piece that kills its process
three times ends the work. Workers end with their parent, also if that is killed.
"""

from __future__ import annotations

import os
import pickle
import signal
import threading
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    wait,
)
from concurrent.futures.process import BrokenProcessPool
from functools import cache
from multiprocessing import get_context, parent_process
from typing import Any, Final, TypeVar

from rigctl.child_process import isolated_children
from rigctl.errors import RigctlError

T = TypeVar("T")
R = TypeVar("R")

#: variables that limit the threads of libraries, which would use every core in each process
_THREADS: Final = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
#: number of worker deaths after which a piece is not submitted again
DEATHS: Final = 3


def in_threads(
    work: Callable[[T], R], pieces: Sequence[T], count: int
) -> Generator[tuple[int, R], None, None]:
    """Yield indices and results from `count` threads in order of completion."""
    pool = ThreadPoolExecutor(count, thread_name_prefix="rigctl-task")
    try:
        yield from _finished(pool, work, pieces, deque(range(len(pieces))), count)
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def in_processes(
    work: Callable[[T], R], pieces: Sequence[T], count: int
) -> Generator[tuple[int, R], None, None]:
    """Yield indices and results from `count` processes in order of completion; a broken pool is replaced.

    Which piece killed its process is unknown: all that were running are submitted again one at a time, so
    that the next death has one cause.
    """
    left = set(range(len(pieces)))
    suspects: set[int] = set()
    deaths: Counter[int] = Counter()
    while left:
        alone = bool(suspects)
        queue, handed_out = deque(sorted(suspects or left)), set[int]()
        try:
            for index, result in _in_new_processes(work, pieces, queue, handed_out, 1 if alone else count):
                left.discard(index)
                suspects.discard(index)
                yield index, result
        except BrokenProcessPool as problem:
            in_work = handed_out & left
            deaths.update(in_work)
            if alone and any(deaths[index] >= DEATHS for index in in_work):
                raise _killed(DEATHS) from problem
            suspects |= in_work


def _killed(times: int) -> RigctlError:
    return RigctlError(
        f"a process was killed, {times} times at the same piece of work; the results so far are kept",
        hint="Fewer '--workers', if memory is short",
    )


def _in_new_processes(
    work: Callable[[T], R], pieces: Sequence[T], queue: deque[int], handed_out: set[int], count: int
) -> Generator[tuple[int, R], None, None]:
    import cloudpickle

    with isolated_children(**_one_thread_each()):
        pool = ProcessPoolExecutor(
            count,
            mp_context=get_context("spawn"),
            initializer=begin_worker,
            initargs=(cloudpickle.dumps(work),),
        )
        try:
            sent = _Sent(pieces)
            for index, result in _finished(pool, _given_work, sent, queue, count, handed_out):
                yield index, pickle.loads(result)  # noqa: S301 - from a process that this one started
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def _finished(
    pool: Executor,
    work: Callable[[Any], Any],
    pieces: Sequence[Any],
    queue: deque[int],
    count: int,
    handed_out: set[int] | None = None,
) -> Iterator[tuple[int, Any]]:
    """Yield results in order of completion; few pieces are submitted ahead, so that interrupts act soon."""
    running: dict[Future[Any], int] = {}
    ahead = count if count == 1 else 2 * count
    while queue or running:
        while queue and len(running) < ahead:
            index = queue.popleft()
            if handed_out is not None:
                handed_out.add(index)
            running[pool.submit(work, pieces[index])] = index
        ready, _ = wait(running, return_when=FIRST_COMPLETED)
        for future in sorted(ready, key=lambda one: one.exception() is not None):  # results before errors
            index = running.pop(future)
            if handed_out is not None and not future.exception():
                handed_out.discard(index)
            yield index, future.result()


#: the pickled function of this worker process, sent once
_sent: bytes = b""


@cache
def _work() -> Callable[[Any], Any]:
    """Unpickle the function within a task, so that a failure is not reported as a dead process."""
    work: Callable[[Any], Any] = pickle.loads(_sent)  # noqa: S301 - from the process that started this one
    return work


def _given_work(piece: bytes) -> bytes:
    """Carry out one piece; piece and result are pickled by cloudpickle, which supports lambdas."""
    import cloudpickle

    result: bytes = cloudpickle.dumps(_work()(pickle.loads(piece)))  # noqa: S301 - from the process that started this one
    return result


class _Sent(Sequence[bytes]):
    """The pickled pieces, each pickled when it is submitted."""

    def __init__(self, pieces: Sequence[Any]) -> None:
        self._pieces = pieces

    def __len__(self) -> int:
        return len(self._pieces)

    def __getitem__(self, index: Any) -> Any:
        import cloudpickle

        return cloudpickle.dumps(self._pieces[index])


def begin_worker(work: bytes = b"") -> None:
    """Initialise a worker: it ends with its parent, and at once on Ctrl-C, which the parent reports."""
    global _sent  # noqa: PLW0603 - set once per process, before any task
    _sent = work
    signal.signal(signal.SIGINT, lambda *_: os._exit(1))
    _end_with_parent()


def _end_with_parent() -> None:
    """End this process as soon as its parent has ended, since a killed parent cannot stop its workers."""
    parent = parent_process()

    def watch() -> None:
        if parent is not None:
            parent.join()
            os._exit(1)  # without clean-up, which would wait for the running task

    threading.Thread(target=watch, daemon=True).start()


def _one_thread_each() -> dict[str, str]:
    """The environment that limits a process to one thread, unless the user has set it."""
    return {name: "1" for name in _THREADS if name not in os.environ}
