"""Parallel work on records."""

from __future__ import annotations

import threading

import pytest

from rigctl.engine.threads import in_threads


def test_results_keep_the_order_of_the_items_and_errors_are_raised(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_NUM_THREADS", "3")
    assert in_threads(lambda k: k * k, range(50)) == [k * k for k in range(50)]
    with pytest.raises(ZeroDivisionError):
        in_threads(lambda k: 1 // k, range(5))


def test_items_are_processed_in_parallel() -> None:
    together = threading.Barrier(2, timeout=30.0)
    assert sorted(in_threads(lambda _: together.wait(), range(2), 2)) == [0, 1]


def test_nested_parallel_work_does_not_deadlock() -> None:
    def outer(k: int) -> list[int]:
        return in_threads(lambda j: 10 * k + j, range(4), 2)

    assert in_threads(outer, range(4), 2) == [[10 * k + j for j in range(4)] for k in range(4)]


def test_with_one_thread_the_work_runs_in_the_callers_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_NUM_THREADS", "1")
    assert in_threads(lambda _: threading.current_thread(), range(3)) == [threading.current_thread()] * 3


def test_no_item_is_started_after_a_failure() -> None:
    begun, failed = [], threading.Event()

    def work(k: int) -> None:
        begun.append(k)
        if k == 1:
            failed.set()
            raise ValueError(k)
        assert failed.wait(30.0)

    with pytest.raises(ValueError, match="1"):
        in_threads(work, range(100), 2)
    ended = len(begun)
    assert in_threads(lambda k: k, range(2), 2) == [0, 1]
    assert len(begun) == ended <= 3


def test_the_most_expensive_items_are_started_first() -> None:
    begun: list[int] = []
    first = threading.Barrier(2, timeout=30.0)

    def work(k: int) -> int:
        begun.append(k)
        if len(begun) <= 2:
            first.wait()
        return k

    assert in_threads(work, range(6), 2, [1, 5, 0, 9, 2, 0]) == list(range(6))
    assert set(begun[:2]) == {3, 1}
    assert sorted(begun) == list(range(6))
