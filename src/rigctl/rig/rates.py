"""The sampling rates that are possible at all, and those of rigctl's own board."""

from __future__ import annotations

from typing import Final

#: Hz; no run could store samples at a higher rate, and a rod or a heater does not move so fast
FASTEST: Final = 1e6
#: of rigctl's own board, Hz
BOARD_RATES: Final = (0.01, 2000.0)
