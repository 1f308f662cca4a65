"""Parallel map over independent tasks."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing
from typing import TypeVar

from rigctl.tasks.workers import Workers

T = TypeVar("T")
R = TypeVar("R")


def map_tasks(
    work: Callable[[T], R],
    pieces: Sequence[T],
    workers: Workers | None = None,
    *,
    on_progress: Callable[[int, int], None] | None = None,
) -> Iterator[tuple[int, R]]:
    """Apply `work` to every piece; yields the index and the result of each in order of completion.

    A caller that stores the results as they come loses none of them to an interrupt. Closing the iterator
    cancels the pieces that have not begun. The piece of a worker that dies is submitted again, up to three
    times.

    Parameters
    ----------
    work: a function, or a partial of one with the data that all pieces share: it is sent once to each worker.
        Large data are passed as paths that workers can read.
    workers: by default one process for each core of this computer.
    on_progress: called with the number of finished pieces and their total.

    Raises
    ------
    RigctlError
        a piece killed its workers, or contact with the cluster was lost. An exception raised by `work` is
        propagated, from the first piece that fails.
    """
    workers = workers or Workers()
    with closing(_results(work, pieces, workers)) as results:
        for done, (index, result) in enumerate(results, start=1):
            if on_progress is not None:
                on_progress(done, len(pieces))
            yield index, result


def _results(
    work: Callable[[T], R], pieces: Sequence[T], workers: Workers
) -> Generator[tuple[int, R], None, None]:
    if pieces and workers.cluster is not None:
        from rigctl.tasks.cluster import on_cluster

        return on_cluster(work, pieces, workers)
    count = workers.for_pieces(len(pieces))
    if count == 1:
        return _sequentially(work, pieces)
    from rigctl.tasks.pools import in_processes, in_threads

    return (in_threads if workers.kind == "threads" else in_processes)(work, pieces, count)


def _sequentially(work: Callable[[T], R], pieces: Sequence[T]) -> Generator[tuple[int, R], None, None]:
    for index, piece in enumerate(pieces):
        yield index, work(piece)
