"""A fitted number over the range of a guess that it follows."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigctl.model.fit.assumptions import Assumption, over_range


@given(
    x=st.floats(-1e3, 1e3, allow_subnormal=False),
    slope=st.floats(-1e6, 1e6),
    assumed=st.floats(1e-3, 1e3),
    factor=st.floats(1.1, 10.0),
)
def test_a_number_over_the_range_of_a_guess_is_finite(
    x: float, slope: float, assumed: float, factor: float
) -> None:
    """However near zero the number is, and however steeply it seems to follow."""
    guess = Assumption("a", assumed, assumed / factor, assumed * factor, "1")
    low, high = over_range(x, 0.1, [(guess, slope)])
    assert math.isfinite(low)
    assert math.isfinite(high)
    assert low <= high


def test_a_product_follows_a_guess_by_its_power() -> None:
    """x = c/a², seen by its slope alone."""
    guess = Assumption("a", 2.0, 1.0, 4.0, "1")
    low, high = over_range(3.0, 0.0, [(guess, -3.0)])
    assert (low, high) == (pytest.approx(0.75), pytest.approx(12.0))
