"""Rows of several devices arrive in any order, and are stored in order of time."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigctl.dataset.recording import samples_file

#: rows that arrive up to 60 s after later ones
arriving = st.lists(st.tuples(st.floats(0.0, 5.0), st.floats(0.0, 50.0)), max_size=60)


@given(steps=arriving, size=st.integers(1, 20))
def test_rows_are_in_order_whole_and_never_at_one_time(steps: list[tuple[float, float]], size: int) -> None:
    """However the journal is divided into blocks, since the same journal gives the same file."""
    now = np.cumsum([step for step, _ in steps] or [0.0])
    late = np.array([delay for _, delay in steps] or [0.0])
    rows = np.column_stack([np.round(now - late, 1), np.arange(len(now), dtype=float)])

    def blocks(each: int) -> Iterator[np.ndarray]:
        for first in range(0, len(rows), each):
            yield rows[first : first + each].copy()

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(samples_file, "GROUP_ROWS", size)
        groups = list(samples_file._in_order(blocks(size)))
    assert all(1 <= len(group) <= size for group in groups)
    ordered = np.concatenate(groups)
    assert np.all(np.diff(ordered[:, 0]) > 0.0)
    assert sorted(ordered[:, 1]) == list(rows[:, 1])
    by_number = ordered[np.argsort(ordered[:, 1]), 0]
    assert by_number == pytest.approx(rows[:, 0], abs=1e-6)
    assert np.array_equal(ordered, np.concatenate(list(samples_file._in_order(blocks(len(rows))))))
