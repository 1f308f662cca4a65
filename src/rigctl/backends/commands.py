"""The check of commands to actuators, shared by all backends."""

from __future__ import annotations

import math

from rigctl.errors import RigctlError, unknown_name
from rigctl.rig import Rig


def check_command(rig: Rig, actuator: str, value: float, duration: float | None = None) -> None:
    """Refuse a command that `actuator` cannot execute, before anything moves.

    Raises
    ------
    RigctlError
        there is no such actuator, its SI value is invalid, or the duration is not positive.
    """
    if actuator not in rig.actuators:
        raise unknown_name("actuator", actuator, rig.actuators)
    if not math.isfinite(value):
        raise RigctlError(f"{actuator}: not a finite number", value=f"{value}")
    try:
        rig.actuators[actuator].check(value)
    except RigctlError as error:
        error.what = f"{actuator}: {error.what}"
        raise
    if duration is None:
        return
    if not (math.isfinite(duration) and duration > 0.0):
        raise RigctlError(f"{actuator}: a pulse must last", value=f"{duration:g} s", expected="e.g. 1.05 s")
    if actuator not in rig.safe_state:
        raise RigctlError(
            f"{actuator}: a pulse needs a value to return to",
            expected=f"'{actuator}' in the rig's safe_state",
        )


def driven_outputs(rig: Rig) -> frozenset[str]:
    """Return the actuators that the bench drives; the others are operated by hand."""
    return frozenset(name for name, actuator in rig.actuators.items() if actuator.by == "driven")
