"""Values of a model set by hand: ``flow_area=3.9 mm^2``, ``valve_leakage.conductance=7e-15 m^3``."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from datetime import UTC, datetime

from rigctl.effects.declaration import qualified
from rigctl.effects.option import read_parameter
from rigctl.errors import RigctlError, unknown_name
from rigctl.model.bounds import within
from rigctl.model.model import Model
from rigctl.model.writing.numbers import value_text
from rigctl.physics.family import ParameterDeclaration
from rigctl.units import read_si


def read_settings(model: Model, written: Mapping[str, str]) -> dict[str, float]:
    """The given values, SI, by the names of `Model.values`.

    Raises
    ------
    RigctlError
        a name is not one of the model's; a value is not a quantity, has another dimension, or is out of
        bounds.
    """
    result: dict[str, float] = {}
    for name, text in written.items():
        effect, dot, parameter = name.partition(".")
        if dot and effect in model.effects:
            # another form of an effect's parameter may be computed from the family's
            family = {key: value for key, value in model.values.items() if "." not in key}
            read = read_parameter(model.effect(effect), parameter, text, family)
            result |= {qualified(effect, key): value for key, value in read.items()}
        elif not dot and name in model.values:
            result[name] = _value(model.family.parameter(name), text)
        else:
            raise unknown_name("parameter of the model", name, model.values)
    return result


def _value(declared: ParameterDeclaration, text: str) -> float:
    try:
        si = read_si(text, declared.unit)
    except RigctlError as error:
        error.what = f"{declared.name}: {error.what}"
        raise
    return within(declared.name, si, *declared.widest, declared.unit, text)


def require_possible(model: Model, name: str, si: float) -> None:
    """Require that a value is within the bounds of its parameter, of the family or of any effect.

    Raises
    ------
    RigctlError
        it is not, or there is no such parameter.
    """
    effect, dot, parameter = name.partition(".")
    if dot:
        declared = model.effect(effect).parameter(parameter)
        low, high = declared.widest
        within(name, si, low, high, declared.unit, difference=declared.difference)
    else:
        of_family = model.family.parameter(name)
        within(name, si, *of_family.widest, of_family.unit)


def set_by_hand(model: Model, values: Mapping[str, float]) -> Model:
    """The model with these values, SI; those that change are noted as set by hand."""
    changed = {name: value for name, value in values.items() if model.values.get(name) != value}
    return model.with_values(changed, source=f"set by hand {datetime.now(UTC):%Y-%m-%d}")


def setting_text(model: Model, name: str, si: float) -> str:
    """A value as written in a file or on a command line: ``3.9 mm^2``.

    Parameters
    ----------
    name: of the model's values, or ``effect.parameter`` of any effect that it could have.
    """
    effect, dot, parameter = name.partition(".")
    if dot:
        declared = model.effect(effect).parameter(parameter)
        low, high = declared.bounds_around(si)
        unit = _stated_unit(model, name) or declared.unit
        return value_text(si, unit, difference=declared.difference, low=low, high=high)
    of_family = model.family.parameter(name)
    unit = _stated_unit(model, name) or of_family.unit
    low, high = of_family.widest
    return value_text(si, unit, low=low, high=high)


def _stated_unit(model: Model, name: str) -> str:
    """The unit in the model's file; "" if the parameter is not in it."""
    effect, dot, parameter = name.partition(".")
    settings = model.effects.get(effect, {}) if dot else model.parameters
    known = settings.get(parameter if dot else name)
    return known.unit if known is not None else ""


def words_of(model: Model, values: Iterable[str], added: Iterable[str], removed: Iterable[str]) -> str:
    """The settings in words, for a model's history: ``flow_area 3.9 mm^2; without piston_leakage``."""
    phrases = [f"{name} {setting_text(model, name, model.values[name])}" for name in values]
    phrases += [f"with {name}" for name in added]
    phrases += [f"without {name}" for name in removed]
    return "; ".join(phrases)
