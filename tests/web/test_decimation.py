"""Decimation of samples to the width of a plot: no peak is lost, and pieces add up to the whole."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from rigctl.web.decimation import Thinning, envelope


def rows_of(seed: int, count: int) -> np.ndarray:
    random = np.random.default_rng(seed)
    time = np.cumsum(random.uniform(0.001, 0.1, count))
    values = random.normal(size=(count, 2)).cumsum(axis=0)
    values[random.random((count, 2)) < 0.1] = np.nan
    return np.column_stack([time, values])


@given(st.integers(0, 10_000), st.integers(0, 300), st.floats(0.01, 2.0))
def test_every_interval_keeps_its_lowest_and_highest_value(seed: int, count: int, stretch: float) -> None:
    rows = rows_of(seed, count)
    thinned = envelope(rows, stretch)
    assert (np.diff(thinned[:, 0]) >= 0).all()
    for number in np.unique(np.floor(rows[:, 0] / stretch)):
        inside = np.floor(rows[:, 0] / stretch) == number
        kept = np.floor(thinned[:, 0] / stretch) == number
        assert 1 <= kept.sum() <= 2
        for column in (1, 2):
            values = rows[inside, column][np.isfinite(rows[inside, column])]
            shown = thinned[kept, column][np.isfinite(thinned[kept, column])]
            if len(values):
                assert (shown.min(), shown.max()) == (values.min(), values.max())
            else:
                assert not len(shown)


@given(
    st.integers(0, 10_000),
    st.lists(st.integers(1, 40), min_size=1, max_size=20),
    st.just(0.0) | st.floats(1e-6, 1.0),
)
def test_decimated_pieces_together_equal_the_decimated_whole(
    seed: int, sizes: list[int], stretch: float
) -> None:
    rows = rows_of(seed, max(sum(sizes), 3))
    thinning, shown, begin = Thinning(stretch), np.empty((0, 3)), 0
    provisional = 0
    for size in [*sizes, len(rows)]:
        piece = rows[begin : begin + size]
        begin += size
        if not len(piece):
            continue
        thinned, more = thinning.take(piece)
        shown = np.concatenate([shown[: len(shown) - provisional], thinned])
        provisional = more
    np.testing.assert_array_equal(shown, envelope(rows, stretch))
