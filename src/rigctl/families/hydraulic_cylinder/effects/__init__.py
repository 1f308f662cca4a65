"""Effects of the valve-controlled cylinder and its tank."""

from rigctl.families.hydraulic_cylinder.effects import (
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
