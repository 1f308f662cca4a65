"""First-order lags that are regular, and exactly absent, at a time constant of zero.

With x the true value and T the lag, ``z = (1 + T0*s) / (1 + (T + T0)*s) * x``: a ramp is delayed by T, and a
step shows a share T0/(T + T0) at once. T0 is far below the sampling interval, so this is the usual lag in
practice; the usual form divides by T and has no derivative at T = 0.
"""

from __future__ import annotations

from rigctl.engine.symbols import Scalar


def deviation_rate(deviation: Scalar, lag: Scalar, resolution: Scalar, rate: Scalar) -> Scalar:
    """``d' = -d / (T + T0) - x'`` for the state d, which is 0 in steady state."""
    return -deviation / (lag + resolution) - rate


def reading_error(deviation: Scalar, lag: Scalar, resolution: Scalar) -> Scalar:
    """``z - x = d * T / (T + T0)``."""
    return deviation * (lag / (lag + resolution))
