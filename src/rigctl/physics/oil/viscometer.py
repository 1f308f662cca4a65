"""The capillary viscometer: the time in which a volume flows out under its own head."""

from __future__ import annotations

import math

from rigctl.engine.symbols import Scalar
from rigctl.physics.constants import GRAVITY


def capillary_constant(bore: float, length: float, volume: float, head: float) -> float:
    """``k = pi * d^4 * g * dh / (128 * l * q)`` in m^2/s^2.

    Parameters
    ----------
    bore: d of the capillary, in m.
    length: l of the capillary, in m.
    volume: q, the volume whose flow time is measured, in m^3.
    head: dh, mean height of the liquid above the outlet, in m.

    Source: Hagen-Poiseuille; ISO 3105.
    """
    return math.pi * bore**4 * GRAVITY * head / (128.0 * length * volume)


def kinematic_from_time(time: Scalar, constant: Scalar, end_correction: Scalar = 0.0) -> Scalar:
    """``nu = k * t - c / t`` in m^2/s; c is the Hagenbach-Couette correction for the loss at the ends.

    Parameters
    ----------
    time: t in s.
    constant: k in m^2/s^2, from `capillary_constant` or a calibration oil.
    end_correction: c in m^2; 0 for none.

    Source: Hagenbach (1860), Couette (1890); ISO 3105 has ``E / t^2`` in place of ``c / t``.
    """
    return constant * time - end_correction / time
