"""The values of a family's parameters: the family's own, the oil's, the rig's, and those given."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Literal

from rigctl.errors import unknown_name
from rigctl.physics.family import ModelFamily
from rigctl.physics.oil import find_oil
from rigctl.rig.rig import Rig


def parameter_values(
    family: ModelFamily,
    rig: Rig | None = None,
    given: Mapping[str, float] | None = None,
    oil: str | None = None,
) -> dict[str, float]:
    """Every parameter of `family` in SI; later sources override earlier ones.

    The family's own values, then the oil's (`oil`, or the rig's), the rig's geometry and constants, `given`.

    Raises
    ------
    RigctlError
        `given` names a parameter that the family does not have, or the oil is unknown.
    """
    values = {parameter.name: parameter.value for parameter in family.parameters}
    oil_name = oil or (rig.oil if rig else None)
    if oil_name:
        values |= {name: value for name, value in _of_oil(oil_name).items() if name in values}
    if rig is not None:
        values |= _of_rig(family, rig)
    for name, value in (given or {}).items():
        if name not in values:
            raise unknown_name(f"parameter of {family.name}", name, values)
        values[name] = value
    return values


def parameter_origins(
    family: ModelFamily, rig: Rig | None, given: Collection[str], oil: str | None
) -> dict[str, Literal["model", "rig", "oil", "family"]]:
    """The origin of each parameter in `parameter_values`; "model" for those in `given`."""
    origins: dict[str, Literal["model", "rig", "oil", "family"]] = {
        p.name: "family" for p in family.parameters
    }
    oil_name = oil or (rig.oil if rig else None)
    if oil_name:
        origins |= {name: "oil" for name in _of_oil(oil_name) if name in origins}
    if rig is not None:
        origins |= dict.fromkeys(_of_rig(family, rig), "rig")
    return origins | dict.fromkeys(given, "model")


def choices(family: ModelFamily, rig: Rig | None) -> dict[str, str]:
    """The variants of the equations selected by the rig's options; none of a program, which has its own.

    Raises
    ------
    RigctlError
        an option that the family does not have, or a choice that the option does not have.
    """
    chosen = dict(rig.options) if rig is not None and family.program is None else {}
    for name, value in chosen.items():
        if name not in family.options:
            raise unknown_name(f"option of {family.name}", name, family.options)
        if value not in family.options[name]:
            raise unknown_name(f"choice of the option '{name}'", value, family.options[name])
    return chosen


def _of_oil(name: str) -> dict[str, float]:
    oil = find_oil(name)
    return {
        "density_15": oil.density_15,
        "thermal_expansion": oil.thermal_expansion,
        "vogel_a": oil.vogel.a,
        "vogel_b": oil.vogel.b,
        "vogel_c": oil.vogel.c,
        "bulk_modulus": oil.bulk_modulus,
        "specific_heat": oil.heat_capacity,
    }


def _of_rig(family: ModelFamily, rig: Rig) -> dict[str, float]:
    """The family's parameters that the rig gives; it may give more, for inputs and effects."""
    known = {parameter.name for parameter in family.parameters}
    return {
        parameter: float(value)
        for name, value in {**rig.geometry, **rig.constants}.items()
        for parameter in family.rig_names.get(name, (name,))
        if parameter in known
    }
