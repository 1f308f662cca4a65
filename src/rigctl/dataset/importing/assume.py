"""Inputs that a file lacks and that are known to have stayed at one value."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from typing import TYPE_CHECKING

from rigctl.dataset.importing.columns import on_rig
from rigctl.errors import RigctlError, nearest_name
from rigctl.units import parse_quantity, read_si

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


def assumed_values(assume: Mapping[str, str], rig: Rig | None, recorded: Collection[str]) -> dict[str, float]:
    """The SI values of what is assumed, by the rig's names.

    Parameters
    ----------
    recorded: what the file has; it need not be assumed.

    Raises
    ------
    RigctlError
        a name is misspelt or recorded, or a value is none or has another dimension.
    """
    found: dict[str, float] = {}
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
        found[ours] = _value(ours, value, rig)
    return found


def _value(name: str, text: str, rig: Rig | None) -> float:
    try:
        if rig is None:
            return parse_quantity(text).si
        if name in rig.actuators:
            return rig.actuators[name].read(text)
        if name in rig.channels:
            channel = rig.channels[name]
            return read_si(text, channel.unit, difference=channel.difference)
        if name in rig.constants:
            constant = rig.constants[name]
            return read_si(text, constant.unit.text)
        # an input of a model of one's own need not be on the rig; a misspelt name must not pass for one
        near = nearest_name(name, [*rig.actuators, *rig.channels, *rig.constants])
        if near is not None:
            raise RigctlError("unknown name", value=name, nearest=near)
        return parse_quantity(text).si
    except RigctlError as problem:
        problem.what = f"--assume: {name}: {problem.what}"
        raise
