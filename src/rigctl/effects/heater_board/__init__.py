"""Effects of the two-heater board."""

from rigctl.effects.heater_board import losses, timing
from rigctl.effects.heater_board.record_level import RECORD_LEVEL as RECORD_LEVEL

EFFECTS = (*losses.EFFECTS, *timing.EFFECTS)
