"""Work in threads or processes of this computer."""

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
from contextlib import contextmanager
from functools import cache
from multiprocessing import get_context, parent_process
from typing import Any, Final, TypeVar

from rigctl.errors import RigctlError

T = TypeVar("T")
R = TypeVar("R")

#: libraries that would use every core in each process
_THREADS: Final = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
#: a piece is given out so often, if those who work on it die
DEATHS: Final = 3


def in_threads(
    work: Callable[[T], R], pieces: Sequence[T], count: int
) -> Generator[tuple[int, R], None, None]:
    """Results as they come, from so many threads."""
    pool = ThreadPoolExecutor(count, thread_name_prefix="rigctl-task")
    try:
        yield from _finished(pool, work, pieces, deque(range(len(pieces))), count)
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def in_processes(
    work: Callable[[T], R], pieces: Sequence[T], count: int
) -> Generator[tuple[int, R], None, None]:
    """Results as they come, from so many processes; a new set of them where one has died.

    Which piece killed its process cannot be seen from here: all that were in work then are given out again,
    one at a time, so that the next death has one cause.
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

    with _one_thread_each():
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
    """Results as they come; few pieces are handed out ahead, so that an interrupt is soon obeyed."""
    running: dict[Future[Any], int] = {}
    ahead = count if count == 1 else 2 * count
    while queue or running:
        while queue and len(running) < ahead:
            index = queue.popleft()
            if handed_out is not None:
                handed_out.add(index)
            running[pool.submit(work, pieces[index])] = index
        ready, _ = wait(running, return_when=FIRST_COMPLETED)
        for future in sorted(ready, key=lambda one: one.exception() is not None):  # first what is there
            index = running.pop(future)
            if handed_out is not None and not future.exception():
                handed_out.discard(index)
            yield index, future.result()


#: what a process of ours does, as it was sent to it, once
_sent: bytes = b""


@cache
def _work() -> Callable[[Any], Any]:
    """Read where a failure to do so can be told, and not only that the process has ended."""
    work: Callable[[Any], Any] = pickle.loads(_sent)  # noqa: S301 - from the process that started this one
    return work


def _given_work(piece: bytes) -> bytes:
    """A piece in, what came of it out, both as bytes: they may hold functions without a name too."""
    import cloudpickle

    result: bytes = cloudpickle.dumps(_work()(pickle.loads(piece)))  # noqa: S301 - likewise
    return result


class _Sent(Sequence[bytes]):
    """The pieces as they are sent, each made when it is handed out."""

    def __init__(self, pieces: Sequence[Any]) -> None:
        self._pieces = pieces

    def __len__(self) -> int:
        return len(self._pieces)

    def __getitem__(self, index: Any) -> Any:
        import cloudpickle

        return cloudpickle.dumps(self._pieces[index])


def begin_worker(work: bytes = b"") -> None:
    """Let this process end with the one that started it, and by Ctrl-C at once: the other one tells of it."""
    global _sent  # noqa: PLW0603 - one per process, set before anything is done in it
    _sent = work
    signal.signal(signal.SIGINT, lambda *_: os._exit(1))
    _end_with_parent()


def _end_with_parent() -> None:
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
