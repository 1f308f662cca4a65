"""Checks of set-points: those that would trip an interlock or cannot be reached are refused beforehand."""

from __future__ import annotations

from rigctl.errors import RigctlError
from rigctl.rig import Rig
from rigctl.units import show


def check_set_point(rig: Rig, channel: str, value: float) -> None:
    """Refuse a set-point (SI) that the channel cannot read, or at which one of its limits would stop the run.

    Raises
    ------
    RigctlError
        the set-point is outside the channel's physical range, or beyond a limit with the action stop, which
        the message names.
    """
    described = rig.channels[channel]

    def shown(value: float) -> str:
        return show(value, described.unit, difference=described.difference)

    if not described.possible(value):
        low, high = described.range or (value, value)
        raise RigctlError(
            f"outside the range of the channel '{channel}'",
            value=shown(value),
            expected=f"{shown(low)} to {shown(high)}",
        )
    for name, limit in rig.limits.items():
        if limit.channel != channel or limit.action != "stop" or not limit.of_value:
            continue
        bound = limit.threshold
        if value > bound if limit.bound == "above" else value < bound:
            side = "at most" if limit.bound == "above" else "at least"
            raise RigctlError(
                f"this set-point would trip the limit '{name}' of '{channel}'",
                value=shown(value),
                expected=f"{side} {shown(bound)}",
            )


def check_level(rig: Rig, actuator: str, value: float) -> None:
    """Refuse a level (SI) outside the actuator's range.

    Raises
    ------
    RigctlError
        the level is out of range; the message names the actuator.
    """
    try:
        rig.actuators[actuator].check(value)
    except RigctlError as error:
        error.what = f"{error.what} of the actuator '{actuator}'"
        raise
