"""Parallel work on records, one thread for each core.

Only worthwhile for work that releases the interpreter lock: kernels, and factorisations of larger matrices.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from functools import cache
from itertools import count
from typing import Generic, TypeVar

T = TypeVar("T")
R = TypeVar("R")

_here = threading.local()


def in_threads(
    work: Callable[[T], R], items: Sequence[T], workers: int | None = None, costs: Sequence[float] = ()
) -> list[R]:
    """The results of `work` for all items, in order; an exception that it raises is propagated.

    Each item is processed independently, so that the results do not depend on the number of threads. Nested
    calls run in the calling thread: if they waited for others, no thread might be left to do the work.

    Parameters
    ----------
    workers: threads, by default one for each core or as many as NUMBA_NUM_THREADS allows.
    costs: estimated cost of each item, in any unit; the most expensive are started first, so that no thread
        is left with a long one at the end (longest processing time first: R. L. Graham, SIAM J. Appl. Math.
        17 (1969) 416).
    """
    threads = min(len(items), workers or _cores())
    if threads <= 1 or getattr(_here, "inside", False):
        return [work(item) for item in items]
    share = _Share(work, items, sorted(range(len(items)), key=lambda k: -costs[k]) if costs else None)
    helpers = [_pool(os.getpid(), threads - 1).submit(share.work_off) for _ in range(threads - 1)]
    _here.inside = True
    try:
        share.work_off()
    finally:
        share.stop()
        _here.inside = False
        wait([helper for helper in helpers if not helper.cancel()])
    return share.all_done()


class _Share(Generic[T, R]):
    """Items taken by several threads, each the next in `order` that none has taken.

    A thread is woken once for all the work, not for every item, because that would delay items that take a
    millisecond.
    """

    def __init__(
        self, work: Callable[[T], R], items: Sequence[T], order: Sequence[int] | None = None
    ) -> None:
        self._work = work
        self._items = items
        self._order = range(len(items)) if order is None else order
        self._next = count()  # taking the next one is atomic in the interpreter
        self._done: dict[int, R] = {}
        self._failed: dict[int, Exception] = {}

    def work_off(self) -> None:
        """Work until nothing is left, or an item has failed."""
        while (taken := next(self._next)) < len(self._items) and not self._failed:
            index = self._order[taken]
            try:
                self._done[index] = self._work(self._items[index])
            except Exception as failure:  # noqa: BLE001 - raised where the results are wanted
                self._failed[index] = failure

    def stop(self) -> None:
        """Discard what no thread has taken yet."""
        self._next = count(len(self._items))

    def all_done(self) -> list[R]:
        """The results in order; raises the exception of the first failed item."""
        if self._failed:
            raise self._failed[min(self._failed)]
        return [self._done[index] for index in range(len(self._items))]


@cache
def _pool(_process: int, threads: int) -> ThreadPoolExecutor:
    """The threads of this process, kept because starting them takes as long as a small evaluation."""
    return ThreadPoolExecutor(threads, thread_name_prefix="rigctl-record", initializer=_enter)


def _enter() -> None:
    _here.inside = True


def _cores() -> int:
    allowed = os.environ.get("NUMBA_NUM_THREADS", "")
    return int(allowed) if allowed.isdigit() and int(allowed) else os.cpu_count() or 1
