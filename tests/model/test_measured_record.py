"""The commands of a record."""

from __future__ import annotations

import numpy as np
import pytest

from rigctl.model.measured.record import MeasuredRecord


def record(inputs: list[list[float]]) -> MeasuredRecord:
    rows = np.array(inputs, dtype=np.float64).reshape(len(inputs), -1)
    return MeasuredRecord(
        run="run",
        index=0,
        label="run/0",
        times=np.arange(10.0),
        switch_times=np.arange(float(len(rows))),
        switch_half=np.zeros(len(rows)),
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
