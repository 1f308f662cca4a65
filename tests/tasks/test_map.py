"""Independent pieces of work: equal results wherever they run, and none lost with a worker."""

from __future__ import annotations

import threading
from functools import partial
from pathlib import Path

import pytest

from rigctl.errors import RigctlError
from rigctl.tasks import Workers, map_tasks, seed_of
from tasks.pieces import deadly, drawn, refused

PLACES = [Workers(1), Workers(3, "threads"), Workers(2)]


@pytest.mark.parametrize("workers", PLACES)
def test_results_do_not_depend_on_worker_or_order(workers: Workers) -> None:
    told: list[tuple[int, int]] = []
    found = dict(map_tasks(drawn, range(8), workers, on_progress=lambda *done: told.append(done)))
    assert found == {piece: (piece, seed_of(7, "piece", piece)) for piece in range(8)}
    assert told == [(done, 8) for done in range(1, 9)]


def test_no_two_pieces_share_a_seed() -> None:
    seeds = {seed_of(seed, name, number) for seed in (0, 1) for name in ("a", "b") for number in range(50)}
    assert len(seeds) == 200
    assert seed_of(1, "a", 11) != seed_of(1, "a1", 1)
    assert all(0 <= seed < 2**63 for seed in seeds)


@pytest.mark.parametrize("workers", PLACES[:2])
def test_a_failing_task_ends_the_map_and_earlier_results_are_kept(workers: Workers) -> None:
    found = []
    with pytest.raises(ValueError, match="piece 3"):
        for _, result in map_tasks(refused, range(100), workers):
            found.append(result)
    assert 3 not in found
    assert len(found) < 100


def test_no_further_work_is_started_after_the_consumer_stops() -> None:
    done: list[int] = []
    lock = threading.Lock()

    def counted(piece: int) -> int:
        with lock:
            done.append(piece)
        return piece

    for _ in map_tasks(counted, range(1000), Workers(2, "threads")):
        break
    assert len(done) < 20


def test_a_worker_process_that_dies_loses_no_result(tmp_path: Path) -> None:
    found = dict(map_tasks(partial(deadly, str(tmp_path), 2), range(12), Workers(2)))
    assert found == {piece: piece * piece for piece in range(12)}


def test_a_task_that_kills_every_worker_is_reported(tmp_path: Path) -> None:
    found = []
    with pytest.raises(RigctlError, match="killed, 3 times at the same piece"):
        for index, _ in map_tasks(partial(deadly, str(tmp_path), 99), range(12), Workers(2)):
            found.append(index)
    assert 5 not in found
    assert len(list(tmp_path.iterdir())) == 3


@pytest.mark.parametrize("address", ["local:0", "local:x", "10.0.0.1:8786", "http://host", ""])
def test_an_invalid_address_is_refused(address: str) -> None:
    with pytest.raises(RigctlError, match="no cluster's address"):
        Workers(cluster=address)
