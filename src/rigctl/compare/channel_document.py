"""A channel's error in the channel's unit, for programs."""

from __future__ import annotations

from typing import Any

from rigctl.model.fit.errors import ChannelError
from rigctl.units import parse_unit


def in_unit(error: ChannelError, unit_name: str) -> dict[str, Any]:
    """`rmse`, `bias`, `max` and `noise` of model less measurement in `unit`, K for a temperature's."""
    unit = parse_unit(unit_name)
    return {
        "rmse": error.rmse / unit.factor,
        "unit": "K" if unit.offset else unit_name,
        "bias": error.bias / unit.factor,
        "max": error.maximum / unit.factor,
        "noise": error.noise / unit.factor,
    }
