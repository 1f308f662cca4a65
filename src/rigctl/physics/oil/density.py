"""Density of the oil at atmospheric pressure."""

from __future__ import annotations

from rigctl.engine.symbols import Scalar, constant_like
from rigctl.physics.constants import ZERO_CELSIUS

#: reference temperature of an oil's density: 15 degC, in K
REFERENCE_TEMPERATURE = ZERO_CELSIUS + 15.0


def density(temperature: Scalar, density_15: Scalar, thermal_expansion: Scalar) -> Scalar:
    """``rho = rho15 * (1 - alpha_v * (T - 15 degC))``, in kg/m^3.

    Parameters
    ----------
    temperature: T in K.
    density_15: rho15 at 15 degC, in kg/m^3.
    thermal_expansion: alpha_v in 1/K; 7e-4 for mineral oils.

    Source: DIN 51757 practice for mineral oils; Merritt (1967), chapter 2.
    """
    return density_15 * (
        1.0 - thermal_expansion * (temperature - constant_like(REFERENCE_TEMPERATURE, temperature))
    )
