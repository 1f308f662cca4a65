"""Execution of tasks on a Dask cluster.

In: a function, its pieces of work, and the address of a scheduler. Out: results in order of completion,
as from `pools`: a caller does not know where they were made.

Few pieces are sent ahead, each to the worker with the fewest, and the rest wait here: an interrupt then
acts soon, and short tasks are spread evenly, which Dask itself would not do. The function is sent once,
with the data it holds. A piece whose worker is lost is sent again. A worker with another version of
rigctl is refused, since its results would differ.
"""

from __future__ import annotations

import logging
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any, Final, NoReturn, TypeVar

from rigctl.child_process import isolated_children
from rigctl.errors import ExitCode, RigctlError
from rigctl.method_version import DISCOVERY_VERSION, METHOD_VERSION
from rigctl.tasks.workers import Workers

if TYPE_CHECKING:
    from distributed import Client, Future

T = TypeVar("T")
R = TypeVar("R")

#: time-out for the scheduler and for its first worker, s
_PATIENCE: Final = 20.0
#: interval between checks of the connection to the scheduler, s
_LOOK: Final = 1.0
#: submitted pieces for each thread of a worker: one running, one queued
_AHEAD: Final = 2
#: mean number of submissions of a piece after its data were lost with a worker
_LOST: Final = 3


def on_cluster(
    work: Callable[[T], R], pieces: Sequence[T], workers: Workers
) -> Generator[tuple[int, R], None, None]:
    """Yield indices and results from the workers of a cluster in order of completion."""
    with _quiet(), _client(workers) as client:
        yield from _Submission(client, work, pieces).results()


class _Submission:
    """Submits few pieces ahead, so that interrupts act soon, and collects their results."""

    def __init__(self, client: Client, work: Callable[[Any], Any], pieces: Sequence[Any]) -> None:
        self._client, self._work, self._pieces = client, work, pieces
        self._waiting = deque(range(len(pieces)))
        self._running: dict[Future, int] = {}
        self._places: dict[Future, str] = {}
        self._lost = 0
        self._sent: Future | None = None

    def results(self) -> Iterator[tuple[int, Any]]:
        """Yield the index and the result of each piece."""
        while self._waiting or self._running:
            try:
                self._hand_out()
                finished = self._finished()
            except (OSError, TimeoutError) as problem:
                self._gone(problem)
            for future in finished:
                index = self._running.pop(future)
                del self._places[future]
                if future.status == "finished":
                    yield index, self._result(future)
                elif future.status == "error":
                    _refuse(future.exception())
                else:
                    self._again(index)

    def _hand_out(self) -> None:
        """Submit as many pieces as the current workers can hold.

        Each goes to the worker with the fewest of them, and the others wait here: the scheduler itself would
        assign short tasks to the workers that already hold the data, and rebalance little. If a worker dies,
        any other takes its pieces.
        """
        threads = self._client.nthreads() or {"": 1}  # without workers, the scheduler queues the pieces
        while self._waiting:
            held = Counter(self._places[future] for future in self._running)
            place = min(threads, key=lambda address: (held[address] / threads[address], address))
            if held[place] >= _AHEAD * threads[place]:
                return
            if self._sent is None:
                self._sent = self._client.scatter(_Sent(self._work), broadcast=True, hash=False)
            index = self._waiting.popleft()
            future = self._client.submit(
                _carried_out,
                self._sent,
                self._pieces[index],
                _version(),
                pure=False,
                workers=[place] if place else None,
                allow_other_workers=bool(place),
            )
            self._running[future], self._places[future] = index, place

    def _finished(self) -> list[Future]:
        from distributed import wait

        # errors of lost futures are handled below, by their states
        with suppress(TimeoutError, CancelledError, OSError), self._client.as_current():
            wait(list(self._running), timeout=_LOOK, return_when="FIRST_COMPLETED")
        if self._client.status != "running":
            self._gone(None)
        return [future for future in self._running if future.done()]

    def _result(self, future: Future) -> Any:
        try:
            return future.result(timeout=_PATIENCE)
        except (OSError, TimeoutError) as problem:
            self._gone(problem)

    def _again(self, index: int) -> None:
        """Submit a piece again, and send the shared data again, which were lost with their workers."""
        self._lost += 1
        if self._lost > _LOST * len(self._pieces):
            self._gone(None)
        self._sent = None
        self._waiting.append(index)

    def _gone(self, problem: BaseException | None) -> NoReturn:
        raise RigctlError(
            "the cluster's scheduler does not answer any more; the results so far are kept",
            hint="Restart the scheduler and repeat the command (rigctl validate: with --resume)",
            exit_code=ExitCode.FAILED,
        ) from problem


class _Sent:
    """The function and its shared data, opaque to the scheduler; sent once."""

    def __init__(self, work: Callable[[Any], Any]) -> None:
        self.work = work


def _carried_out(sent: _Sent, piece: Any, version: str) -> Any:
    """Carry out a piece on a worker; refuse another version of rigctl, whose results would differ."""
    if version != _version():
        raise RigctlError(
            "a worker of the cluster has another rigctl", value=_version(), expected=version,
            hint="Install the same version on every worker", exit_code=ExitCode.FAILED,
        )  # fmt: skip
    return sent.work(piece)


def _version() -> str:
    from importlib.metadata import version

    return f"{version('rigctl')}, method {METHOD_VERSION}, discovery {DISCOVERY_VERSION}"


def _refuse(problem: BaseException) -> NoReturn:
    from distributed.scheduler import KilledWorker

    if isinstance(problem, KilledWorker):
        raise RigctlError(
            "a piece of work killed its workers again and again; the results so far are kept",
            hint="Workers with more memory, or fewer of them on one computer",
            exit_code=ExitCode.FAILED,
        ) from problem
    if isinstance(problem, ImportError):
        raise RigctlError(
            f"a worker of the cluster cannot do the work: {problem}",
            hint="Install the same rigctl on every worker",
            exit_code=ExitCode.FAILED,
        ) from problem
    raise problem


@contextmanager
def _client(workers: Workers) -> Iterator[Client]:
    """Connect to the scheduler, after starting a temporary local cluster if requested."""
    try:
        from distributed import Client, LocalCluster
    except ImportError as problem:
        raise RigctlError(
            "'distributed' is not installed, which work on a cluster needs",
            hint="pip install 'rigctl[cluster]'",
        ) from problem
    cluster = None
    if workers.local_count is not None:
        with isolated_children():
            cluster = LocalCluster(
                n_workers=workers.local_count,
                threads_per_worker=1,
                processes=True,
                dashboard_address=None,
                host="127.0.0.1",
            )
    try:
        client = _connected(Client, workers.cluster if cluster is None else cluster)
        try:
            yield client
        finally:
            with suppress(Exception):
                client.close(timeout=2)
    finally:
        if cluster is not None:
            with suppress(Exception):
                cluster.close(timeout=5)


def _connected(make: Callable[..., Client], where: Any) -> Client:
    try:
        client = make(where, timeout=_PATIENCE, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as problem:
        raise RigctlError(
            "no scheduler of a cluster answers",
            value=str(where),
            hint="'dask scheduler' starts one, 'dask worker tcp://HOST:8786 --nthreads 1' a worker",
            exit_code=ExitCode.FAILED,
        ) from problem
    try:
        client.wait_for_workers(1, timeout=_PATIENCE)
    except (OSError, TimeoutError) as problem:
        with suppress(Exception):
            client.close(timeout=2)
        raise RigctlError(
            "the cluster has no workers",
            value=str(where),
            hint="'dask worker ADDRESS --nthreads 1' starts one",
            exit_code=ExitCode.FAILED,
        ) from problem
    return client


@contextmanager
def _quiet() -> Iterator[None]:
    """Silence the library's log, which would repeat at length what is raised as an error."""
    logger = logging.getLogger("distributed")
    before = logger.level
    logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        logger.setLevel(before)
