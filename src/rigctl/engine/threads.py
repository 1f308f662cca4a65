"""Work on records side by side, one thread for each core.

What is worth it releases the interpreter: kernels, and the factorisations of matrices of some size.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import TypeVar

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
    return list(_pool(os.getpid(), threads).map(work, items))


@cache
def _pool(_process: int, threads: int) -> ThreadPoolExecutor:
    """The threads of this process: to start them for every evaluation takes as long as a small one."""
    return ThreadPoolExecutor(threads, thread_name_prefix="rigctl-record", initializer=_enter)


def _enter() -> None:
    _here.inside = True


def _cores() -> int:
    allowed = os.environ.get("NUMBA_NUM_THREADS", "")
    return int(allowed) if allowed.isdigit() and int(allowed) else os.cpu_count() or 1
