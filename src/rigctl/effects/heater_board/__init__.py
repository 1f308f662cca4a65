"""Effects of the two-heater board."""

from rigctl.effects.heater_board import losses, timing

EFFECTS = (*losses.EFFECTS, *timing.EFFECTS)
