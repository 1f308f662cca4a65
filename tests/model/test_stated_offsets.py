"""Readings of a clock whose offset is stated, at the times at which they were taken."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigctl.errors import RigctlError
from rigctl.model.measured.offsets import as_taken, moved_lines, stated_offsets
from rigctl.rig.clock import Clock


@given(
    late=st.tuples(*[st.integers(-3000, 3000).map(lambda ms: 1e-3 * ms)] * 2),
    gaps=st.lists(st.integers(1, 2000), min_size=5, max_size=40),
    seed=st.integers(0, 1000),
)
def test_each_reading_within_the_record_is_kept_once_at_its_own_time(
    late: tuple[float, float], gaps: list[int], seed: int
) -> None:
    times = 1e-3 * np.cumsum(gaps)
    times -= times[0]
    rng = np.random.default_rng(seed)
    values = rng.standard_normal((times.size, 2))
    values[rng.uniform(size=values.shape) < 0.4] = np.nan
    if max(map(abs, late)) > 0.5 * times[-1]:
        with pytest.raises(RigctlError, match="off by more than half of record run/0"):
            as_taken(times, values, late, "run/0")
        return
    taken, moved = as_taken(times, values, late, "run/0")
    assert np.all(np.diff(taken) > 0.0)
    assert taken[0] == times[0]
    assert taken[-1] == pytest.approx(times[-1])
    for k, one in enumerate(late):
        here = np.isfinite(moved[:, k])
        at = times + one
        inside = np.isfinite(values[:, k]) & (at >= times[0] - 1e-10) & (at <= times[-1] + 1e-10)
        assert np.array_equal(moved[here, k], values[inside, k])
        assert taken[here] == pytest.approx(at[inside], abs=1e-8)


def test_without_an_offset_a_record_is_the_same_object() -> None:
    times, values = np.arange(3.0), np.ones((3, 2))
    taken, moved = as_taken(times, values, [0.0, 0.0], "run/0")
    assert taken is times
    assert moved is values
    knots, lines = moved_lines(times, values, [0.0, 0.0])
    assert knots is times
    assert lines is values


def test_an_offset_is_that_of_each_channel_of_its_clock() -> None:
    clocks = {
        "daq": Clock.model_validate({"channels": ["p", "x"], "offset": "-12 ms", "uncertainty": "2 ms"}),
        "meter": Clock.model_validate({"channels": ["T"], "uncertainty": "2 ms"}),
    }
    assert stated_offsets(clocks) == {"p": pytest.approx(-0.012), "x": pytest.approx(-0.012)}
