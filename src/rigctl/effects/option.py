"""An effect on the command line: ``piston_leakage:clearance=30 um``."""

from __future__ import annotations

from collections.abc import Mapping

from rigctl.effects.declaration import Effect
from rigctl.effects.registry import find_effect
from rigctl.errors import RigctlError, unknown_name
from rigctl.physics.families import find_family
from rigctl.units import read_si, show


def parse_effect_option(
    text: str, family: str = "hydraulic_cylinder", parameters: Mapping[str, float] | None = None
) -> tuple[str, dict[str, float]]:
    """Read ``EFFECT[:param=value[,param=value...]]`` into its name and all its parameters in SI.

    Parameters that are not given have their typical size. `parameters` are the family's, where a bench's
    differ from the published one.

    Raises
    ------
    RigctlError
        an unknown effect or parameter, a wrong unit, a value out of bounds, or base physics, which every
        model has already.
    """
    name, _, rest = text.partition(":")
    effect = find_effect(name.strip(), family)
    if effect.base:
        raise RigctlError(
            f"{effect.name} is base physics, which every model has", hint="Set the model's parameters instead"
        )
    values = effect.start
    for item in filter(None, (part.strip() for part in rest.split(","))):
        key, equals, written = item.partition("=")
        if not equals:
            raise RigctlError("not a parameter of an effect", value=item, expected="'parameter=value'")
        values |= read_parameter(effect, key.strip(), written.strip(), parameters)
    return effect.name, values


def read_parameter(
    effect: Effect, name: str, written: str, family_parameters: Mapping[str, float] | None = None
) -> dict[str, float]:
    """The parameter that ``name: written`` sets, in SI; `name` may be another way to write one.

    Raises
    ------
    RigctlError
        an unknown parameter, a wrong unit, or a value out of bounds.
    """
    family = find_family(effect.family)
    for way in effect.other_ways:
        if way.name == name:
            known = {p.name: p.value for p in family.parameters} | dict(family_parameters or {})
            return _bounded(effect, way.parameter, way.value_of(read_si(written, way.unit), known), written)
    names = [p.name for p in effect.parameters] + [way.name for way in effect.other_ways]
    if name not in names:
        raise unknown_name(f"parameter of {effect.name}", name, names)
    parameter = effect.parameter(name)
    return _bounded(effect, name, read_si(written, parameter.unit, difference=parameter.difference), written)


def _bounded(effect: Effect, name: str, value: float, written: str) -> dict[str, float]:
    parameter = effect.parameter(name)
    if not parameter.low <= value <= parameter.high:
        low, high = (
            show(end, parameter.unit, difference=parameter.difference)
            for end in (parameter.low, parameter.high)
        )
        raise RigctlError(
            f"{effect.name}.{name} is out of bounds", value=written, expected=f"{low} to {high}"
        )
    return {name: value}
