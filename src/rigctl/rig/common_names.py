"""Names common to all benches, and their equivalents on one bench."""

from __future__ import annotations

from rigctl.rig.rig import Rig


def on_rig(name: str, rig: Rig) -> str:
    """Return the rig's name for a name common to all benches."""
    if name in rig.channels or name in rig.actuators:
        return name
    roles = rig.roles
    if name == "pressure_setpoint" and roles.set_pressure is not None:
        return roles.set_pressure.actuator
    if name == "heater" and roles.heat is not None:
        return roles.heat.actuator
    moves = {role.actuator for role in (roles.extend, roles.retract) if role is not None}
    if name == "valve" and len(moves) == 1:
        return moves.pop()
    return name
