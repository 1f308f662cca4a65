"""Linear algebra on one thread, while records or refits are what runs side by side.

The matrices here are small: a library that starts threads for them spends more on waiting than on work, many
times as much when the cores are busy.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def one_thread() -> Iterator[None]:
    """Keep BLAS and LAPACK to the calling thread for the time of the block."""
    from threadpoolctl import threadpool_limits

    with threadpool_limits(limits=1, user_api="blas"):
        yield
