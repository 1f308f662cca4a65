"""Bars of block characters."""

from __future__ import annotations

import math

from hypothesis import given
from hypothesis import strategies as st

from rigctl.cli.terminal_bars import draw_bar


def eighths(bar: str) -> int:
    return sum(0x2590 - ord(character) for character in bar)  # from the full block, U+2588, down


@given(st.floats(1e-9, 1e9), st.floats(1e-3, 1.0))
def test_the_length_of_a_bar_is_proportional_to_its_value(largest: float, share: float) -> None:
    bar = draw_bar(share * largest, largest, width=40)
    assert abs(eighths(bar) - max(320 * share, 1)) <= 1
    assert len(bar) <= 40


def test_a_bar_of_zero_or_undefined_length_is_empty() -> None:
    assert draw_bar(0.0, 1.0) == draw_bar(math.nan, 1.0) == draw_bar(1.0, 0.0) == ""
    assert draw_bar(2.0, 1.0, width=3) == "███"
    assert draw_bar(1e-9, 1.0) == "▏"
