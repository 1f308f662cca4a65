"""Effective bulk modulus of oil with entrained air.

A volume of oil with the free-air fraction x0 at atmospheric pressure becomes, at absolute pressure p,
``V = (1 - x0) + x0 * g`` with ``g = (p_atm / p)^(1/n)``; the small change of the liquid's volume is neglected
in V, but not in its derivative ``-dV/dp = (1 - x0) / beta + x0 * g / (n * p)``.

Source: Jelali & Kroll, Hydraulic Servo-systems (2003), section 3.2; Merritt (1967), section 2-4.
"""

from __future__ import annotations

from rigctl.engine.symbols import Scalar, constant_like, power
from rigctl.physics.constants import ATMOSPHERE

#: polytropic exponent of bubbles compressed too fast to exchange heat
ADIABATIC_AIR = 1.4


def air_compliance(
    absolute_pressure: Scalar, air_fraction: Scalar, bulk_modulus: Scalar, exponent: float = ADIABATIC_AIR
) -> Scalar:
    """Added compressibility: ``1/beta_eff - 1/beta = x0*g*(1/(n*p) - 1/beta) / (1 - x0 + x0*g)``, in 1/Pa.

    Exactly 0 without air. With it ``beta_eff = V / (-dV/dp)`` of oil and air together.

    Parameters
    ----------
    absolute_pressure: p in Pa, above 0.
    air_fraction: x0, the free-air fraction of the volume at atmospheric pressure.
    bulk_modulus: beta of the oil without air, in Pa; about 1.4e9.
    exponent: n, 1 (slow) to 1.4 (fast).
    """
    atmosphere = constant_like(ATMOSPHERE, absolute_pressure)
    expansion = power(atmosphere / absolute_pressure, 1.0 / exponent)
    air = air_fraction * expansion
    softer = 1.0 / (exponent * absolute_pressure) - 1.0 / bulk_modulus
    return air * softer / (1.0 - air_fraction + air)
