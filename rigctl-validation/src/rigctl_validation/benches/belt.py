"""A carriage on a toothed belt behind a servo drive; it can hide the backlash of its gear."""

from __future__ import annotations

import numpy as np

from rigctl_validation.benches.bench import Draw, Floats, Hidden, Signal, SmallBench, Trace
from rigctl_validation.benches.motion import integrate, sampled, steps

#: rad/s of the drive, of the records
_LEVELS = ((5, -5, 3), (8, 0, -8), (-4, 4, -2), (6, -3, 3), (-7, 7, 0), (3, -6, 6), (4, 0, -4), (-5, 2, 5))


def simulate(draw: Draw) -> list[Trace]:
    """``dw/dt = (w_set − w)/T``, ``dphi/dt = w``; ``dx/dt = r·(1 + e·(warmth − 25 degC))·w``.

    The carriage rests by its friction until the slack of the gear has been taken up.
    """
    lag, radius = draw.about(0.08, 0.1), draw.about(20.0, 0.03)
    time = draw.times(2.4)
    records = []
    for levels in _LEVELS:
        instants = draw.switches((0.2, 0.9, 1.6))
        speed = steps(instants, levels)
        warmth = draw.optional(25.0, 5.0, 2.0)

        def rates(t: float, y: Floats, u: Signal = speed, b: Signal = warmth) -> tuple[float, float, float]:
            pitch = radius * (1.0 + 1e-3 * (b(t) - 25.0))
            return float(y[1]), float((u(t) - y[1]) / lag), float(pitch * y[1])

        fine = np.linspace(0.0, float(time[-1]), 8 * (time.size - 1) + 1)
        states = integrate(rates, (0.0, 0.0, 0.0), fine, instants)
        followed = _slack(states[:, 2], draw.amplitude)
        records.append(
            Trace(
                time,
                {
                    "drive": sampled(speed, time),
                    "warmth": sampled(warmth, time),
                    "angle": states[::8, 0],
                    "carriage": followed[::8],
                },
            )
        )
    return records


def _slack(moved: Floats, width: float) -> Floats:
    """The motion behind a gear with slack, which is initially taken up on the rear side."""
    followed = np.empty_like(moved)
    at = moved[0]
    for index, position in enumerate(moved):
        at = min(max(at, position - width), position)
        followed[index] = at
    return followed


BENCH = SmallBench(
    name="belt",
    title="carriage on a toothed belt",
    columns={"drive": "rad/s", "warmth": "degC", "angle": "rad", "carriage": "mm"},
    noise={"angle": 2e-3, "carriage": 0.05},
    optional="warmth",
    spread=5.0,
    time_constant=0.08,
    simulate=simulate,
    hidden=Hidden("backlash of the gear", "mm", 0.05, 10.0, ("hysteresis_of_carriage",)),
)
