"""Linear algebra on one thread, while records or refits run in parallel.

The matrices are small: a library that starts threads for them spends more time waiting than working, many
times as much when the cores are busy.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def one_thread() -> Iterator[None]:
    """Restrict BLAS and LAPACK to the calling thread within the block."""
    from threadpoolctl import threadpool_limits

    with threadpool_limits(limits=1, user_api="blas"):
        yield
