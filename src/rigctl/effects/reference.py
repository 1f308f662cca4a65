"""The reference temperature of thermal effects."""

from __future__ import annotations

from rigctl.engine.symbols import Scalar, constant_like
from rigctl.physics.constants import ZERO_CELSIUS


def above_20_celsius(temperature: Scalar) -> Scalar:
    """``T - 20 degC`` in K."""
    return temperature - constant_like(ZERO_CELSIUS + 20.0, temperature)
