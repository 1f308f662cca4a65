"""Work on records side by side, one thread for each core.

What is worth it releases the interpreter: kernels, and the factorisations of matrices of some size.
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


def in_threads(work: Callable[[T], R], items: Sequence[T], workers: int | None = None) -> list[R]:
    """The results of `work` on all items, in order; what it raises is raised.

    Each item is worked on alone, so that the results do not depend on how many threads there are. What is
    called by such work stays in its thread: were it to wait for others, none might be left to do the work.

    Parameters
    ----------
    workers: threads, by default one for each core or as many as NUMBA_NUM_THREADS allows.
    """
    threads = min(len(items), workers or _cores())
    if threads <= 1 or getattr(_here, "inside", False):
        return [work(item) for item in items]
    share = _Share(work, items)
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
    """Items that several threads take one after the other, each the next that none has taken.

    A thread is told once that there is work, not for every item: items of a millisecond would wait for that.
    """

    def __init__(self, work: Callable[[T], R], items: Sequence[T]) -> None:
        self._work = work
        self._items = items
        self._next = count()  # taking the next is one step of the interpreter
        self._done: dict[int, R] = {}
        self._failed: dict[int, Exception] = {}

    def work_off(self) -> None:
        """Work until nothing is left, or an item has failed."""
        while (index := next(self._next)) < len(self._items) and not self._failed:
            try:
                self._done[index] = self._work(self._items[index])
            except Exception as failure:  # noqa: BLE001 - raised where the results are wanted
                self._failed[index] = failure

    def stop(self) -> None:
        """Leave what no thread has taken yet."""
        self._next = count(len(self._items))

    def all_done(self) -> list[R]:
        """The results in order; raises what the first failed item has raised."""
        if self._failed:
            raise self._failed[min(self._failed)]
        return [self._done[index] for index in range(len(self._items))]


@cache
def _pool(_process: int, threads: int) -> ThreadPoolExecutor:
    """The threads of this process: to start them for every evaluation takes as long as a small one."""
    return ThreadPoolExecutor(threads, thread_name_prefix="rigctl-record", initializer=_enter)


def _enter() -> None:
    _here.inside = True


def _cores() -> int:
    allowed = os.environ.get("NUMBA_NUM_THREADS", "")
    return int(allowed) if allowed.isdigit() and int(allowed) else os.cpu_count() or 1
