"""First-order lags that are regular, and exactly absent, at a time constant of zero.

With x the truth and T the lag, ``z = (1 + T0*s) / (1 + (T + T0)*s) * x``: a ramp arrives late by T, a step
shows a share T0/(T + T0) at once. T0 is well below what the sampling resolves, so this is the usual lag; the
usual form divides by T and has no derivative at T = 0.
"""

from __future__ import annotations

from rigctl.engine.symbols import Scalar


def deviation_rate(deviation: Scalar, lag: Scalar, resolution: Scalar, rate: Scalar) -> Scalar:
    """``d' = -d / (T + T0) - x'`` for the state d, which is 0 when all is settled."""
    return -deviation / (lag + resolution) - rate


def reading_error(deviation: Scalar, lag: Scalar, resolution: Scalar) -> Scalar:
    """``z - x = d * T / (T + T0)``."""
    return deviation * (lag / (lag + resolution))
