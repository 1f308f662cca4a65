"""Settings of the simulated bench that a real bench does not need."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from rigctl.files.amount import AnyAmount
from rigctl.files.name import Name
from rigctl.files.quantity import Q
from rigctl.rig.base import RigFilePart


class Simulation(RigFilePart):
    """Initial state, surroundings and randomness of the simulated bench."""

    initial: dict[Name, AnyAmount] = Field(
        default_factory=dict, description="initial readings of the channels"
    )
    ambient_temperature: Annotated[float, Q("K")] = Field(
        default=293.15, description="temperature around the tank"
    )
    pump: bool = Field(default=True, description="whether the pump runs")
    noise: bool = Field(default=True, description="whether the channels' noise is added")
    seed: int = Field(default=0, ge=0, description="seed of the noise: the same seed gives the same samples")
    answer_delay: Annotated[float, Q("s", low="0 s")] = Field(
        default=0.0, description="response time of the simulated operator"
    )
    scatter: dict[Name, Annotated[float, Q("1", low="0", high="1")]] = Field(
        default_factory=dict, description="relative standard deviation of each new setting, by actuator"
    )
