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
