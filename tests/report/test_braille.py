"""Curves of braille dots."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from rigctl.report.braille import draw_curve


def dots(lines: list[str]) -> set[tuple[int, int]]:
    """(column, row) of every dot, by the bits of Unicode's braille block."""
    found = set()
    order = [(0, 0), (0, 1), (0, 2), (1, 0), (1, 1), (1, 2), (0, 3), (1, 3)]
    for y, line in enumerate(lines):
        for x, character in enumerate(line):
            bits = ord(character) - 0x2800
            found |= {(2 * x + dx, 4 * y + dy) for bit, (dx, dy) in enumerate(order) if bits >> bit & 1}
    return found


def test_a_straight_line_climbs_from_corner_to_corner() -> None:
    drawn = dots(draw_curve(list(range(8)), width=4, height=2, low=0.0, high=7.0))
    assert {(0, 7), (7, 0)} <= drawn
    assert (0, 0) not in drawn
    assert (7, 7) not in drawn


def test_a_constant_is_one_line() -> None:
    assert draw_curve([0.0] * 9, width=3, height=1, low=0.0, high=1.0) == ["⣀⣀⣀"]
    assert draw_curve([2.0], width=2, height=1, low=2.0, high=2.0) == ["⠉⠉"]


def test_a_single_peak_among_many_values_is_seen() -> None:
    values = [0.0] * 5000
    values[3210] = 1.0
    drawn = dots(draw_curve(values, width=10, height=1, low=0.0, high=1.0))
    assert {row for column, row in drawn if column == 12} == {0, 1, 2, 3}


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=300), st.integers(1, 20), st.integers(1, 5))
def test_every_column_has_a_dot_and_every_line_its_width(
    values: list[float], width: int, height: int
) -> None:
    lines = draw_curve(values, width=width, height=height, low=min(values), high=max(values))
    assert [len(line) for line in lines] == [width] * height
    assert {column for column, _ in dots(lines)} == set(range(2 * width))
