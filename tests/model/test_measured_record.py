"""The commands of a record."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rigctl.design.virtual_records import PlannedRecord
from rigctl.model.fit.switching import scattered, switch_unknowns
from rigctl.model.measured.record import MeasuredRecord, Measurements


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


def test_of_streamed_commands_none_jitters() -> None:
    """Scattered times of every one of them would be a random walk of the output."""
    levels = [[float(k % 3)] for k in range(8)]
    streamed = replace(record(levels), switch_jitter=np.full(8, 0.1))
    assert streamed.streamed
    assert streamed.rough_switches.size == 0
    assert scattered(streamed)[0] == ()


def test_a_planned_switch_jitters_as_those_measured_of_its_input() -> None:
    jitter = np.array([0.0, 0.02, 0.0, 0.02])
    rows = [[0.0, 1.0], [1.0, 1.0], [1.0, 2.0], [0.0, 2.0]]
    measured = replace(record(rows), switch_jitter=jitter)
    data = Measurements(("y",), ("m",), ("valve", "level"), (measured,), None, ("run",))
    planned = np.array([[0.0, 0.0], [0.0, 1.0], [1.0, 1.0], [0.0, 0.0]])
    np.testing.assert_allclose(data.jitter_of(planned), [0.0, 0.0, 0.02, 0.02])
    many = np.array([[float(k % 2), 1.0] for k in range(20)])
    one = PlannedRecord(np.arange(20.0), many, 30.0, 10.0, {}).record(data)
    # each has its own: no readings give a noise that could hold their scatter
    assert len(switch_unknowns(one)) == 19
