"""The one way in which independent pieces of work are carried out."""

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
    """Carry out `work` on every piece; the index of each and what came of it, as they are finished.

    Whoever keeps them as they come loses nothing to an interrupt. To stop, close the iterator, or leave the
    loop: what has not begun is then not begun. A worker that dies loses its own piece, which another one is
    given; a piece that has cost three workers their life is not given out again.

    Parameters
    ----------
    work: a module's function, or a partial of one: it is sent to other processes, once to each, with what all
        pieces need; large data go as paths where workers can read them.
    workers: where; on each core of this computer when left out.
    on_progress: told how many are done, and of how many.

    Raises
    ------
    RigctlError
        a piece killed its workers, or the cluster cannot be reached any more. What `work` raises comes out
        here, from the first piece that does.
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
        return _here(work, pieces)
    from rigctl.tasks.pools import in_processes, in_threads

    return (in_threads if workers.kind == "threads" else in_processes)(work, pieces, count)


def _here(work: Callable[[T], R], pieces: Sequence[T]) -> Generator[tuple[int, R], None, None]:
    for index, piece in enumerate(pieces):
        yield index, work(piece)
