"""Oils by name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from rigctl.errors import unknown_name
from rigctl.physics.oil.density import density
from rigctl.physics.oil.viscosity import barus_factor, modulus_factor
from rigctl.physics.oil.vogel_points import VogelConstants


@dataclass(frozen=True)
class Oil:
    """Properties of an oil, SI.

    Attributes
    ----------
    name: in files.
    density_15: kg/m^3 at 15 degC.
    thermal_expansion: alpha_v in 1/K.
    vogel: the constants of Vogel's law.
    pressure_viscosity: Barus' coefficient in 1/Pa.
    modulus: a1 in Pa, a2 in Pa/K, b1, b2 in 1/K of the modulus equation.
    bulk_modulus: of the oil without air, in Pa.
    heat_capacity: cp in J/(kg*K).
    """

    name: str
    description: str
    density_15: float
    thermal_expansion: float
    vogel: VogelConstants
    pressure_viscosity: float
    modulus: tuple[float, float, float, float]
    bulk_modulus: float
    heat_capacity: float
    source: str

    def density(self, temperature: float) -> float:
        """In kg/m^3, at `temperature` in K and atmospheric pressure."""
        return float(density(temperature, self.density_15, self.thermal_expansion))

    def dynamic_viscosity(self, temperature: float, pressure: float = 0.0, law: str = "barus") -> float:
        """In Pa*s, at `temperature` in K and gauge `pressure` in Pa.

        Raises
        ------
        RigctlError
            the pressure law is neither "barus" nor "modulus", or the temperature is below the pole of Vogel's
            law.
        """
        if law not in ("barus", "modulus"):
            raise unknown_name("viscosity model", law, ("barus", "modulus"))
        if law == "barus":
            factor = barus_factor(pressure, self.pressure_viscosity)
        else:
            factor = modulus_factor(pressure, temperature, self.modulus)
        return self.vogel.viscosity(temperature) * float(factor)

    def kinematic_viscosity(self, temperature: float, pressure: float = 0.0, law: str = "barus") -> float:
        """In m^2/s; the density is that at atmospheric pressure."""
        return self.dynamic_viscosity(temperature, pressure, law) / self.density(temperature)


HL32 = Oil(
    name="HL32",
    description="ISO VG 32 mineral hydraulic oil with VI of 95 or more",
    density_15=870.0,
    thermal_expansion=7e-4,
    vogel=VogelConstants(a=3.1083e-5, b=1132.5833, c=147.4466),
    pressure_viscosity=2e-8,
    modulus=(334e5, 3.2557e5, 0.026266, 0.000315),
    bulk_modulus=1.4e9,
    heat_capacity=1900.0,
    source=(
        "Vogel constants as printed by Hashim, Al-Salihi & Al Zubaidi; pressure terms are typical of HM "
        "oils, after Knezevic & Savic (2006), not measured on this oil"
    ),
)

OILS: Mapping[str, Oil] = MappingProxyType({HL32.name: HL32})


def find_oil(name: str) -> Oil:
    """The oil called `name`, ignoring case.

    Raises
    ------
    RigctlError
        there is none; the message gives the nearest name.
    """
    for known in OILS.values():
        if known.name.casefold() == name.strip().casefold():
            return known
    raise unknown_name("oil", name, OILS)
