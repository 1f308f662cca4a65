"""The history kept for windows that open late: as long as promised, within the memory limit."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rigctl.web.recent_rows import KeptRows


def filled(step: float, blocks: int, rows: int, *, seconds: float = 900.0, most: int = 150_000) -> KeptRows:
    """Blocks of `rows` rows each, `step` s apart; the value is the number of the row."""
    kept = KeptRows(2, seconds, most)
    for k in range(blocks):
        number = np.arange(k * rows, (k + 1) * rows, dtype=float)
        kept.append(np.column_stack([number * step, number]))
    return kept


@pytest.mark.parametrize("blocks", [1, 100, 2_001, 4_500, 20_001])
@pytest.mark.parametrize(("step", "rows"), [(0.01, 10), (0.1, 1), (0.01, 3000)])
def test_the_promised_history_is_kept(step: float, rows: int, blocks: int) -> None:
    blocks = min(blocks, 300_000 // rows)
    kept = filled(step, blocks, rows, most=100_000)
    seen = kept.last(900.0)
    count = blocks * rows
    assert len(seen) == pytest.approx(min(count, round(900.0 / step) + 1), abs=1)
    assert seen[-1, 1] == count - 1
    assert np.all(np.diff(seen[:, 1]) == 1.0)
    held = sum(len(block) for block in kept._blocks)
    assert held == kept._count <= min(900.0 / step, 100_000) + 2 * max(rows, 2000)


def test_the_history_of_a_fast_run_is_limited_by_memory() -> None:
    kept = filled(1e-3, 1_000, 1_000, most=150_000)
    assert len(kept.last(900.0)) == 150_000
    assert kept.last(10.0)[0, 0] == pytest.approx(kept.newest - 10.0, abs=1e-3)


def test_the_first_value_after_a_time_is_found_and_nan_is_skipped() -> None:
    kept = KeptRows(2, 900.0, 1000)
    assert math.isnan(kept.newest)
    assert math.isnan(kept.oldest)
    assert kept.last(10.0).shape == (0, 2)
    assert kept.first_value(1, 0.0) is None
    kept.append(np.array([[0.0, 1.0], [1.0, math.nan], [2.0, 3.0]]))
    assert (kept.oldest, kept.newest) == (0.0, 2.0)
    assert kept.first_value(1, 0.5) == 3.0
    assert kept.first_value(1, 2.5) is None
