"""Model families by name."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from rigctl.errors import unknown_name
from rigctl.physics.family import ModelFamily
from rigctl.physics.heater_board import HEATER_BOARD
from rigctl.physics.hydraulic_cylinder import HYDRAULIC_CYLINDER
from rigctl.physics.oil_viscosity import OIL_VISCOSITY

FAMILIES: Mapping[str, ModelFamily] = MappingProxyType(
    {family.name: family for family in (HYDRAULIC_CYLINDER, HEATER_BOARD, OIL_VISCOSITY)}
)


def find_family(name: str) -> ModelFamily:
    """The family called `name`.

    Raises
    ------
    RigctlError
        there is none; it says the nearest.
    """
    if name not in FAMILIES:
        raise unknown_name("model family", name, FAMILIES)
    return FAMILIES[name]
