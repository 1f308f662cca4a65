"""Effects of the valve-controlled cylinder and its tank."""

from rigctl.effects.hydraulic_cylinder import (
    base,
    friction,
    heat,
    leakage,
    load,
    oil,
    sensors,
    supply,
    switching,
    throttle,
)
from rigctl.effects.hydraulic_cylinder.record_level import RECORD_LEVEL as RECORD_LEVEL

EFFECTS = (
    *leakage.EFFECTS,
    *supply.EFFECTS,
    *throttle.EFFECTS,
    *oil.EFFECTS,
    *friction.EFFECTS,
    *load.EFFECTS,
    *switching.EFFECTS,
    *sensors.EFFECTS,
    *heat.EFFECTS,
    *base.EFFECTS,
)
