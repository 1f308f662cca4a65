"""Model families by name."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from rigctl.errors import unknown_name
from rigctl.physics.family import ModelFamily
from rigctl.physics.hydraulic_cylinder import HYDRAULIC_CYLINDER

FAMILIES: Mapping[str, ModelFamily] = MappingProxyType({HYDRAULIC_CYLINDER.name: HYDRAULIC_CYLINDER})


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
