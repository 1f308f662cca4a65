"""Mineral hydraulic oil: density, viscosity and the compressibility of its air."""

from rigctl.physics.oil.bulk_modulus import air_compliance
from rigctl.physics.oil.density import density
from rigctl.physics.oil.oils import HL32, OILS, Oil, find_oil
from rigctl.physics.oil.published import Misfit, largest_misfit, misfit, published_viscosity
from rigctl.physics.oil.table import OilRow, oil_table
from rigctl.physics.oil.viscosity import (
    barus_factor,
    kinematic_viscosity,
    modulus_coefficient,
    modulus_factor,
    vogel,
    walther,
    walther_constants,
)
from rigctl.physics.oil.vogel_points import VogelConstants, vogel_from_points

__all__ = [
    "HL32",
    "OILS",
    "Misfit",
    "Oil",
    "OilRow",
    "VogelConstants",
    "air_compliance",
    "barus_factor",
    "density",
    "find_oil",
    "kinematic_viscosity",
    "largest_misfit",
    "misfit",
    "modulus_coefficient",
    "modulus_factor",
    "oil_table",
    "published_viscosity",
    "vogel",
    "vogel_from_points",
    "walther",
    "walther_constants",
]
