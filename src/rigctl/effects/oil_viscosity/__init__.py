"""Effects of the viscosity table."""

from rigctl.effects.oil_viscosity import laws, measurement

EFFECTS = (*laws.EFFECTS, *measurement.EFFECTS)
