"""What a user says of an input that was not recorded: ``heater=0``, ``ambient=21 degC``.

One reading for an import and for an analysis: the unit is always written, unless the input has none.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from rigctl.errors import RigctlError
from rigctl.units import parse_quantity, parse_unit, read_si

if TYPE_CHECKING:
    from rigctl.rig import Rig


def read_assumptions(texts: Iterable[str]) -> dict[str, str]:
    """Read ``NAME=VALUE`` pairs, one in each text.

    Raises
    ------
    RigctlError
        there is no name or no value, or a name comes twice.
    """
    found: dict[str, str] = {}
    for text in texts:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not (name and equals and value):
            raise RigctlError(
                "--assume: not a value for a name", value=text, expected="name=value, e.g. 'ambient=21 degC'"
            )
        if name in found:
            raise RigctlError("--assume: the name is there twice", value=name)
        found[name] = value
    return found


def assumed_value(
    name: str, text: str, rig: Rig | None, unit: str | None = None, *, difference: bool = False
) -> float:
    """The SI value that `text` says of `name`.

    A number without a unit is taken for a position or for a plain number, never for SI: ``21`` of a
    temperature would be 21 K.

    Parameters
    ----------
    unit, difference: of an input that the rig does not know; None where nobody says its dimension.

    Raises
    ------
    RigctlError
        it is no value, its unit is missing or has another dimension, or it is out of the actuator's range.
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
    """The unit that the rig shows it in, and whether that is of a difference."""
    if rig is None:
        return None
    if name in rig.actuators:
        return rig.actuators[name].display_unit, False
    if name in rig.channels:
        return rig.channels[name].unit, rig.channels[name].difference
    return (rig.constants[name].unit.text, False) if name in rig.constants else None


def _require_unit(text: str, unit: str | None, *, difference: bool) -> None:
    """Refuse a bare number of what has a dimension, or may have one."""
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
