"""Inputs that a file lacks and that are known to have been constant."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING

from rigctl.dataset.assumptions import assumed_value
from rigctl.errors import RigctlError, nearest_name
from rigctl.rig.common_names import on_rig

if TYPE_CHECKING:
    from rigctl.rig import Rig


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
