from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigctl.dataset.conditions import cluster


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ([], []),
        ([313.0], [313.0]),
        ([313.0, 313.4, 313.9], [313.4, 313.4, 313.4]),
        ([313.0, 323.0, 313.5], [313.25, 323.0, 313.25]),
        ([1.0, 1.9, 2.8, 3.7], [1.45, 1.45, 3.25, 3.25]),
    ],
)
def test_values_within_a_kelvin_are_one_condition(values: list[float], expected: list[float]) -> None:
    assert cluster(values) == pytest.approx(expected)


@given(st.lists(st.floats(250.0, 400.0)))
def test_no_value_moves_by_more_than_the_width(values: list[float]) -> None:
    assert all(abs(after - before) <= 1.0 for before, after in zip(values, cluster(values), strict=True))


def test_a_missing_value_stays_missing() -> None:
    found = cluster([300.0, math.nan, 300.5])
    assert math.isnan(found[1])
    assert found[0] == found[2] == 300.25
