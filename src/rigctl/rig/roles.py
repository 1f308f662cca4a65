"""The actuators and channels of the steps of a procedure."""

from __future__ import annotations

from collections.abc import Container

from pydantic import Field

from rigctl.files.amount import AnyDifference
from rigctl.rig.base import RigFilePart
from rigctl.rig.setting import Setting


class HeatRole(RigFilePart):
    """The actuator and channel of `heat`."""

    actuator: str
    channel: str
    hysteresis: AnyDifference | None = Field(
        default=None, description="half width of the band in which the heater is not switched"
    )


class SetRole(RigFilePart):
    """The actuator and channel of `set_pressure`."""

    actuator: str
    channel: str


class MoveRole(RigFilePart):
    """The actuator of `extend` or `retract`, its position, and the channel of the motion."""

    actuator: str
    value: Setting = Field(description="the position, e.g. extend or 1")
    position: str | None = Field(default=None, description="the channel that measures the position")


class Roles(RigFilePart):
    """Steps that need a missing role are refused before anything moves."""

    heat: HeatRole | None = None
    set_pressure: SetRole | None = None
    extend: MoveRole | None = None
    retract: MoveRole | None = None

    def within(self, names: Container[str]) -> Roles:
        """Return the roles whose actuator and channel are among `names`."""
        kept = {}
        for role in type(self).model_fields:
            part = getattr(self, role)
            if part is not None:
                parties = (part.actuator, part.position if isinstance(part, MoveRole) else part.channel)
                kept[role] = part if all(one is None or one in names for one in parties) else None
        return self.model_copy(update=kept)
