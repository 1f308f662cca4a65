"""Values that a user states for inputs that were not recorded: ``heater=0``, ``ambient=21 degC``.

Imports and analyses share this parser: a unit is required unless the quantity is dimensionless.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from typing import TYPE_CHECKING

from rigctl.errors import RigctlError, nearest_name
from rigctl.rig.common_names import on_rig
from rigctl.units import parse_quantity, parse_unit, read_si

if TYPE_CHECKING:
    from rigctl.rig import Rig


def read_assumptions(texts: Iterable[str]) -> dict[str, str]:
    """Read ``NAME=VALUE`` pairs, one in each text.

    Raises
    ------
    RigctlError
        a name or value is missing, or a name is repeated.
    """
    assumptions: dict[str, str] = {}
    for text in texts:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not (name and equals and value):
            raise RigctlError(
                "--assume: not a value for a name", value=text, expected="name=value, e.g. 'ambient=21 degC'"
            )
        if name in assumptions:
            raise RigctlError("--assume: the name is there twice", value=name)
        assumptions[name] = value
    return assumptions


def assumed_value(
    name: str, text: str, rig: Rig | None, unit: str | None = None, *, difference: bool = False
) -> float:
    """Return the SI value of `name` given by `text`.

    A number without a unit is a position or a dimensionless number, never an SI value: ``21`` for a
    temperature would be 21 K.

    Parameters
    ----------
    unit, difference: of an input that the rig does not have; None if its dimension is unknown.

    Raises
    ------
    RigctlError
        `text` is not a value, its unit is missing or has the wrong dimension, or it is outside the actuator's
        range.
    """
    try:
        if rig is not None and name in rig.actuators and rig.actuators[name].kind != "level":
            return rig.actuators[name].read(text)
        shown, interval = _unit_on(rig, name) or (unit, difference)
        _require_unit(text, shown, difference=interval)
        if rig is not None and name in rig.actuators:
            return rig.actuators[name].read(text)
        return parse_quantity(text).si if shown is None else read_si(text, shown, difference=interval)
    except RigctlError as problem:
        problem.what = f"--assume: {name}: {problem.what}"
        raise


def _unit_on(rig: Rig | None, name: str) -> tuple[str, bool] | None:
    """Return the display unit of the rig, and whether it is the unit of a difference."""
    if rig is None:
        return None
    if name in rig.actuators:
        return rig.actuators[name].display_unit, False
    if name in rig.channels:
        return rig.channels[name].unit, rig.channels[name].difference
    return (rig.constants[name].unit.text, False) if name in rig.constants else None


def _require_unit(text: str, unit: str | None, *, difference: bool) -> None:
    """Refuse a number without a unit for a quantity that has, or may have, a dimension."""
    try:
        float(text)
    except ValueError:
        return
    if unit is None:
        expected = f"a number with its unit, e.g. '{text} degC'; '{text} 1' of what has none"
    elif parse_unit(unit).dimension.dimensionless:
        return
    else:
        expected = f"{text} {'degC' if unit == 'K' and not difference else unit}"
    raise RigctlError("the unit is missing", value=text, expected=expected)


def assumed_values(assume: Mapping[str, str], rig: Rig | None, recorded: Collection[str]) -> dict[str, float]:
    """Return the assumed SI values, by the rig's names.

    Parameters
    ----------
    recorded: names in the file, which must not be assumed.

    Raises
    ------
    RigctlError
        a name is misspelt or recorded, or a value is invalid, lacks its unit or has the wrong dimension.
    """
    values: dict[str, float] = {}
    for name, value in assume.items():
        ours = on_rig(name, rig) if rig is not None else name
        if ours in recorded:
            raise RigctlError(
                f"--assume: {name} is in the file",
                value=f"{name}={value}",
                hint=f"Leave the column out, --columns '{name}=-', or do not assume it",
            )
        if not name.isidentifier():
            raise RigctlError("--assume: not a name", value=name, expected="a name such as heater")
        if rig is not None:
            _require_known(ours, rig)
        values[ours] = assumed_value(ours, value, rig)
    return values


def _require_known(name: str, rig: Rig) -> None:
    """Refuse a misspelt name; an input of a user's own model need not be on the rig."""
    names = [*rig.actuators, *rig.channels, *rig.constants]
    near = nearest_name(name, names) if name not in names else None
    if near is not None:
        raise RigctlError(f"--assume: {name}: unknown name", value=name, nearest=near)
