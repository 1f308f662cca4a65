"""Effects of the two-heater board."""

from rigctl.families.heater_board.effects import losses, timing

EFFECTS = (*losses.EFFECTS, *timing.EFFECTS)
