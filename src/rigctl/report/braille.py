"""A curve drawn with braille characters, two dots wide and four high each, for a terminal."""

from __future__ import annotations

from collections.abc import Sequence

#: the bit of each dot of a braille character, by row and column
_DOTS = ((0x01, 0x08), (0x02, 0x10), (0x04, 0x20), (0x40, 0x80))
_EMPTY = 0x2800


def draw_curve(
    values: Sequence[float], *, width: int = 60, height: int = 4, low: float, high: float
) -> list[str]:
    """Lines of text with the curve of equally spaced `values`, between `low` and `high`.

    Every column of dots covers the range of the values in it, and joins the previous column, so that no peak
    is lost however many values there are.

    Parameters
    ----------
    width, height: in characters.
    """
    columns, rows = 2 * width, 4 * height
    cells = [[0] * width for _ in range(height)]
    span = high - low or 1.0

    def row_of(value: float) -> int:
        return min(max(round((high - value) / span * (rows - 1)), 0), rows - 1)

    for column, part in enumerate(_parts(values, columns)):
        for row in range(row_of(max(part)), row_of(min(part)) + 1):
            cells[row // 4][column // 2] |= _DOTS[row % 4][column % 2]
    return ["".join(chr(_EMPTY + bits) for bits in line) for line in cells]


def _parts(values: Sequence[float], columns: int) -> list[Sequence[float]]:
    """The values in each column, preceded by the last one of the previous column."""
    count = len(values)
    parts = []
    for column in range(columns):
        first, last = column * count // columns, max((column + 1) * count // columns, 1)
        parts.append(values[max(min(first, count - 1) - 1, 0) : last] or values[-1:])
    return parts
