"""An edge that several devices see at once, by which the offsets of their clocks are measured."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from rigctl.files.name import Name
from rigctl.files.quantity import Q
from rigctl.rig.base import RigFilePart
from rigctl.rig.setting import Setting


class Align(RigFilePart):
    """What `rigctl doctor --align` commands, and which channel of each device sees it.

    What lies between the output and a channel counts as an offset of its clock: a wire does, a pipe or a
    heater does not.
    """

    actuator: Name = Field(description="the output that is commanded, back and forth")
    to: Setting = Field(description="what it is set to, from its safe state")
    channels: tuple[Name, ...] = Field(
        min_length=1, description="one of each device, wired to the output or reading it back"
    )
    hold: Annotated[float, Q("s", positive=True)] = Field(
        default=1.0, description="how long each setting stays; offsets up to a quarter of it are measured"
    )
    repeats: int = Field(default=12, ge=4, le=1000, description="how often it is set and set back")
