"""Effects of the viscosity table."""

from rigctl.families.oil_viscosity.effects import laws, measurement

EFFECTS = (*laws.EFFECTS, *measurement.EFFECTS)
