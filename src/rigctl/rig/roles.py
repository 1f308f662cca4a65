"""The actuators and channels of the steps of a procedure."""

from __future__ import annotations

from pydantic import Field

from rigctl.files.amount import AnyDifference
from rigctl.rig.base import Part
from rigctl.rig.setting import Setting


class HeatRole(Part):
    """The actuator and channel of `heat`."""

    actuator: str
    channel: str
    hysteresis: AnyDifference | None = Field(
        default=None, description="half width of the band in which the heater is not switched"
    )


class SetRole(Part):
    """The actuator and channel of `set_pressure`."""

    actuator: str
    channel: str


class MoveRole(Part):
    """The actuator of `extend` or `retract`, its position, and the channel of the motion."""

    actuator: str
    value: Setting = Field(description="the position, e.g. extend or 1")
    position: str | None = Field(default=None, description="the channel that measures the position")


class Roles(Part):
    """Steps that need a missing role are refused before anything moves."""

    heat: HeatRole | None = None
    set_pressure: SetRole | None = None
    extend: MoveRole | None = None
    retract: MoveRole | None = None
