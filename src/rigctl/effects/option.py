"""An effect on the command line: ``piston_leakage:clearance=30 um``, or ``my-effect.yaml:size=3 N``."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

from rigctl.effects.declaration import Effect
from rigctl.effects.registry import find_effect
from rigctl.effects.user.load import is_effect_file, load_effect
from rigctl.errors import Location, RigctlError, unknown_name
from rigctl.physics.family import ModelFamily
from rigctl.project import find_project
from rigctl.units import Quantity, onto_bound, read_si, show

_FILE = re.compile(r"(.+?\.ya?ml)(?:\s*:(.*))?$", re.IGNORECASE | re.DOTALL)


def read_effect_option(
    text: str,
    family: str | ModelFamily = "hydraulic_cylinder",
    parameters: Mapping[str, float] | None = None,
) -> tuple[Effect, dict[str, float]]:
    """Read ``EFFECT[:param=value[,param=value...]]`` into the effect and all its parameters in SI.

    EFFECT is a name of the library, or a user's effect file. Parameters that are not given have their typical
    size. `parameters` are the family's, if a bench's differ from the published one.

    Raises
    ------
    RigctlError
        an unknown effect or parameter, a wrong file, a wrong unit, a value out of bounds, or base physics,
        which every model has already.
    """
    name, rest = _split(text)
    effect = name_or_file(name, family)
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
    return effect, values


def name_or_file(written: str, family: str | ModelFamily) -> Effect:
    """The effect of the library, or of a user's file, that `written` names.

    A file is searched in the current folder, then in the project, then among the shipped ones.

    Raises
    ------
    RigctlError
        there is none, the file is wrong, or its effect belongs to another family.
    """
    if not is_effect_file(written):
        return find_effect(written, family)
    path = Path(written)
    effect = load_effect(path if path.exists() else find_project().resolve(path))
    wanted = family if isinstance(family, str) else family.name
    if effect.family != wanted:
        raise RigctlError(
            f"the effect {effect.name} belongs to another family",
            value=effect.family,
            expected=wanted,
            where=Location(path),
        )
    return effect


def _split(text: str) -> tuple[str, str]:
    """The effect, and the text after the colon; the path of a file may contain a colon too."""
    file = _FILE.match(text)
    name, rest = (file.group(1), file.group(2) or "") if file else text.partition(":")[::2]
    return name.strip(), rest


def read_parameter(
    effect: Effect, name: str, written: str | Quantity, family_parameters: Mapping[str, float] | None = None
) -> dict[str, float]:
    """The parameter set by ``name: written`` and its value in SI; `name` may be an alternative form of it.

    Raises
    ------
    RigctlError
        an unknown parameter, a wrong unit, or a value out of bounds.
    """
    family = effect.model_family
    # Alternative forms first: they have names and units of their own, and are converted with the dimensions
    # of the bench.
    for way in effect.other_ways:
        if way.name == name:
            known = {p.name: p.value for p in family.parameters} | dict(family_parameters or {})
            size = way.value_of(_read(effect, name, written, way.unit), known)
            return _bounded(effect, name, way.parameter, size, written)
    names = [p.name for p in effect.parameters] + [way.name for way in effect.other_ways]
    if name not in names:
        raise unknown_name(f"parameter of {effect.name}", name, names)
    parameter = effect.parameter(name)
    size = _read(effect, name, written, parameter.unit, difference=parameter.difference)
    return _bounded(effect, name, name, size, written)


def _read(
    effect: Effect, name: str, written: str | Quantity, unit: str, *, difference: bool = False
) -> float:
    """The SI value of the text; an error message names the parameter."""
    try:
        return read_si(written, unit, difference=difference)
    except RigctlError as error:
        error.what = f"{effect.name}: {name}: {error.what}"
        raise


def _bounded(effect: Effect, way: str, name: str, value: float, written: str | Quantity) -> dict[str, float]:
    """The parameter `name` with its SI value, checked against its bounds; it was written as `way`."""
    parameter = effect.parameter(name)
    value = onto_bound(value, parameter.low, parameter.high)
    # Beyond a usual bound a value is allowed, as a search goes there too; beyond a physical one it is not.
    lowest, highest = parameter.widest
    if not lowest <= value <= highest:
        low, high = (show(end, parameter.unit, difference=parameter.difference) for end in (lowest, highest))
        meant = "" if way == name else f"what makes the {name} "
        raise RigctlError(
            f"{effect.name}: {way}: out of bounds", value=str(written), expected=f"{meant}{low} to {high}"
        )
    return {name: value}
