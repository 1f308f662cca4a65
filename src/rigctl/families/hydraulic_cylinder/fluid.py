"""The oil in the cylinder: density, viscosity and bulk modulus at its temperature and pressure."""

from __future__ import annotations

from rigctl.engine.symbols import Scalar, constant_like, smooth_step
from rigctl.physics import oil
from rigctl.physics.scope import Scope

#: gauge pressure at which vapour has halved the bulk modulus, in Pa; without air it cannot reach -1 bar
VAPOUR_PRESSURE = -0.7e5
#: width of that transition, in Pa
VAPOUR_WIDTH = 3e3


def line_temperature(m: Scope) -> Scalar:
    """Temperature of the oil in lines and cylinder: that of the tank, unless an effect changes it."""
    return m.oil_temperature + m.total("line_temperature")


def density(m: Scope) -> Scalar:
    """Density of the oil in lines and cylinder."""
    return oil.density(m.line_temperature, m.density_15, m.thermal_expansion)


def viscosity(m: Scope) -> Scalar:
    """Viscosity of the oil in the cylinder, at the mean pressure of its chambers."""
    return viscosity_at(m, 0.5 * (m.pressure_a + m.pressure_b))


def viscosity_at(m: Scope, pressure: Scalar) -> Scalar:
    """Dynamic viscosity at a gauge pressure: Vogel's law times the factors of effects."""
    at_atmosphere = oil.vogel(m.line_temperature, m.vogel_a, m.vogel_b, m.vogel_c)
    return at_atmosphere * m.factor("viscosity", pressure=pressure)


def bulk_modulus_at(m: Scope, pressure: Scalar) -> Scalar:
    """Effective bulk modulus at a gauge pressure: ``h(p) / (1/beta + sum of compliances)``.

    h decreases from 1 to 0 where vapour forms, around `VAPOUR_PRESSURE`.
    """
    compliance = 1.0 / m.bulk_modulus + m.total("compliance", pressure=pressure)
    return smooth_step(pressure - constant_like(VAPOUR_PRESSURE, pressure), VAPOUR_WIDTH) / compliance
