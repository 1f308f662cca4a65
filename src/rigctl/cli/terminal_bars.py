"""A horizontal bar of block characters, with a resolution of an eighth of a character, for a terminal."""

from __future__ import annotations

import math

_EIGHTHS = " ▏▎▍▌▋▊▉█"


def draw_bar(value: float, largest: float, *, width: int = 40) -> str:
    """A bar of `value`, where `largest` fills the width; empty unless it is a positive number."""
    if not (value > 0.0 and largest > 0.0 and math.isfinite(value)):
        return ""
    eighths = max(round(min(value / largest, 1.0) * width * 8), 1)
    full, rest = divmod(eighths, 8)
    return _EIGHTHS[8] * full + (_EIGHTHS[rest] if rest else "")
