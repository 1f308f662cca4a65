"""Inputs that a file lacks and that are known to have stayed at one value."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING

from rigctl.dataset.assumptions import assumed_value
from rigctl.dataset.importing.columns import on_rig
from rigctl.errors import RigctlError, nearest_name

if TYPE_CHECKING:
    from rigctl.rig import Rig


def assumed_values(assume: Mapping[str, str], rig: Rig | None, recorded: Collection[str]) -> dict[str, float]:
    """The SI values of what is assumed, by the rig's names.

    Parameters
    ----------
    recorded: what the file has; it need not be assumed.

    Raises
    ------
    RigctlError
        a name is misspelt or recorded, or a value is none, lacks its unit or has another dimension.
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
        if rig is not None:
            _require_known(ours, rig)
        found[ours] = assumed_value(ours, value, rig)
    return found


def _require_known(name: str, rig: Rig) -> None:
    """An input of a model of one's own need not be on the rig; a misspelt name must not pass for one."""
    names = [*rig.actuators, *rig.channels, *rig.constants]
    near = nearest_name(name, names) if name not in names else None
    if near is not None:
        raise RigctlError(f"--assume: {name}: unknown name", value=name, nearest=near)
