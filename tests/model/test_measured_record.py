"""The commands of a record."""

from __future__ import annotations

import numpy as np
import pytest

from rigctl.model.fit.switching import scattered
from rigctl.model.measured.record import MeasuredRecord


def record(inputs: list[list[float]], half: float = 0.0) -> MeasuredRecord:
    rows = np.array(inputs, dtype=np.float64).reshape(len(inputs), -1)
    return MeasuredRecord(
        run="run",
        index=0,
        label="run/0",
        times=np.arange(10.0),
        switch_times=np.arange(float(len(rows))),
        switch_half=np.full(len(rows), half),
        inputs=rows,
        values=np.zeros((10, 1)),
        condition={},
        group=0,
        phase=np.zeros(10, dtype=np.intp),
        phases=("free",),
    )


@pytest.mark.parametrize(
    ("inputs", "kinds"),
    [([[0.0], [2.0], [1.0], [0.0]], [2, 0, 1, 2]), ([[5.0]], [1]), ([[]], [0])],
    ids=["up, down, off", "one command", "a family without inputs"],
)
def test_switches_are_classified_as_up_down_or_to_zero(inputs: list[list[float]], kinds: list[int]) -> None:
    assert record(inputs).switch_kinds.tolist() == kinds


def test_a_command_that_changes_with_most_samples_is_late_by_the_same_each_time() -> None:
    """A controller writes it; delays of its rises and falls of their own would act as an offset."""
    levels = [[float(k % 3)] for k in range(8)]
    streamed, now_and_then = record(levels, 0.5), record(levels[:5], 0.5)
    assert streamed.streamed
    assert set(streamed.switch_kinds.tolist()) == {0}
    assert scattered(streamed)[0] == ()
    assert not now_and_then.streamed
    assert set(now_and_then.switch_kinds.tolist()) == {0, 2}
    assert not record(levels).streamed  # its times are exact
