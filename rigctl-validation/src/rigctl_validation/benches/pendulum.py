"""A pendulum driven by a torque; it can hide the drag of the air, in proportion to its speed squared."""

from __future__ import annotations

import math

import numpy as np

from rigctl_validation.benches.bench import Draw, Floats, Hidden, Signal, SmallBench, Trace
from rigctl_validation.benches.motion import integrate, sampled, steps

#: N*m, of the records
_LEVELS = ((1.0, 0), (1.3, 0.5), (-1.2, 0.2), (0.5, -0.6), (1.4, 0.4), (-1.4, 0), (0.8, 1.4), (-0.8, 0.1))
_GRAVITY = 9.80665


def simulate(draw: Draw) -> list[Trace]:
    """``J·dw/dt = torque − m·g·l·sin(angle − tilt) − d·w − drag·w·|w|``."""
    inertia, weight = draw.about(0.20, 0.05), 0.5 * _GRAVITY * 0.6
    damping = draw.about(0.02, 0.2)
    time = draw.times(8.0)
    records = []
    for levels in _LEVELS:
        instants = draw.switches((0.3, 4.0))
        torque = steps(instants, levels)
        tilt = draw.optional(0.0, 1.5, 6.0)

        def rates(t: float, y: Floats, u: Signal = torque, b: Signal = tilt) -> tuple[float, float]:
            back = weight * math.sin(y[0] - math.radians(b(t)))
            drag = draw.amplitude * y[1] * abs(y[1])
            return float(y[1]), float((u(t) - back - damping * y[1] - drag) / inertia)

        states = integrate(rates, (math.radians(tilt(0.0)), 0.0), time, instants)
        records.append(
            Trace(
                time,
                {
                    "torque": sampled(torque, time),
                    "tilt": sampled(tilt, time),
                    "angle": np.degrees(states[:, 0]),
                },
            )
        )
    return records


BENCH = SmallBench(
    name="pendulum",
    title="pendulum driven by a torque",
    columns={"torque": "N*m", "tilt": "deg", "angle": "deg"},
    noise={"angle": 0.2},
    optional="tilt",
    spread=1.5,
    time_constant=0.25,
    simulate=simulate,
    hidden=Hidden("drag of the air", "N*m*s^2", 2e-3, 0.2, ("quadratic_drag_on_velocity",)),
)
