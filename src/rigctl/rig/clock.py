"""A clock that gives the times of some channels, and may be off."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from rigctl.files.name import Name
from rigctl.files.quantity import Q
from rigctl.rig.base import RigFilePart


class Clock(RigFilePart):
    """The channels whose readings one device or logger dates, with a clock that may be off.

    Its offset counts against the clock of the commands, by which every channel under no clock is dated. For
    several devices, `rigctl doctor --align` measures it. It is
    one number, the same for all its channels and in all records: a clock that is set anew is another one,
    with a name of its own. Tables of single values have no times, and no clock.
    """

    channels: tuple[Name, ...] = Field(
        min_length=1, description="the channels that it dates: outputs of the model, or measured inputs"
    )
    offset: Annotated[float, Q("s")] = Field(
        default=0.0,
        description="how far it is behind the commands: its readings were taken that much later than they "
        "say, e.g. '12 ms'; negative if it is ahead",
    )
    uncertainty: Annotated[float, Q("s", positive=True)] = Field(
        description="how far it may be off from that, 95 %, e.g. '50 ms'"
    )
