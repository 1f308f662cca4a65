"""The sampling rates that are possible at all, those of rigctl's own board, and the baud rates of lines."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

#: Hz; no run could store samples at a higher rate, and a rod or a heater does not move so fast
FASTEST: Final = 1e6
#: of rigctl's own board, Hz
BOARD_RATES: Final = (0.01, 2000.0)
#: bits per second of a serial line by the kind of backend, unless the rig file states them; of Modbus RTU
#: the default of its standard
BAUDS: Final[Mapping[str, int]] = {"serial": 115200, "emulated": 115200, "modbus": 19200, "visa": 9600}
