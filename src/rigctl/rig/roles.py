"""Which actuator and which channel the steps of a procedure mean."""

from __future__ import annotations

from pydantic import Field

from rigctl.files.amount import AnyDifference
from rigctl.rig.base import Part
from rigctl.rig.setting import Setting


class HeatRole(Part):
    """What `heat` switches and watches."""

    actuator: str
    channel: str
    hysteresis: AnyDifference | None = Field(
        default=None, description="half width of the band in which the heater is left as it is"
    )


class SetRole(Part):
    """What `set_pressure` sets and watches."""

    actuator: str
    channel: str


class MoveRole(Part):
    """What `extend` or `retract` switches, to which position, and where the motion is read."""

    actuator: str
    value: Setting = Field(description="the position, e.g. extend or 1")
    position: str | None = Field(default=None, description="the channel that reads the position")


class Roles(Part):
    """Steps that a rig without the role cannot carry out are refused before anything moves."""

    heat: HeatRole | None = None
    set_pressure: SetRole | None = None
    extend: MoveRole | None = None
    retract: MoveRole | None = None
