"""A carriage on a toothed belt behind a servo drive; it can hide the backlash of its gear."""

from __future__ import annotations

import numpy as np

from rigctl.validation.benches.bench import Draw, Floats, Hidden, Signal, SmallBench, Trace
from rigctl.validation.benches.motion import integrate, sampled, steps

#: rad/s of the drive, of the records
_LEVELS = ((5, -5, 3), (8, 0, -8), (-4, 4, -2), (6, -3, 3), (-7, 7, 0), (3, -6, 6), (4, 0, -4), (-5, 2, 5))


def simulate(draw: Draw) -> list[Trace]:
    """``dw/dt = (w_set − w)/T``, ``dphi/dt = w``; the carriage is at ``r·phi·(1 + e·(warmth − 25 K))``.

    The carriage rests by its friction until the slack of the gear has been taken up.
    """
    lag, radius = draw.about(0.08, 0.1), draw.about(20.0, 0.03)
    time = draw.times(2.4)
    records = []
    for levels in _LEVELS:
        instants = draw.switches((0.2, 0.9, 1.6))
        speed = steps(instants, levels)
        stretch = draw.optional(0.0, 0.3, 2.0)

        def rates(t: float, y: Floats, u: Signal = speed) -> tuple[float, float]:
            return float(y[1]), float((u(t) - y[1]) / lag)

        fine = np.linspace(0.0, float(time[-1]), 8 * (time.size - 1) + 1)
        states = integrate(rates, (0.0, 0.0), fine, instants)
        followed = _slack(radius * states[:, 0], draw.amplitude)
        shift = sampled(stretch, time)
        records.append(
            Trace(
                time,
                {
                    "drive": sampled(speed, time),
                    "stretch": shift,
                    "angle": states[::8, 0],
                    "carriage": followed[::8] + shift,
                },
            )
        )
    return records


def _slack(moved: Floats, width: float) -> Floats:
    """What follows a motion with slack; at the start it has been taken up on the rear side."""
    followed = np.empty_like(moved)
    at = moved[0]
    for place, here in enumerate(moved):
        at = min(max(at, here - width), here)
        followed[place] = at
    return followed


BENCH = SmallBench(
    name="belt",
    title="carriage on a toothed belt",
    columns={"drive": "rad/s", "stretch": "mm", "angle": "rad", "carriage": "mm"},
    noise={"angle": 2e-3, "carriage": 0.05},
    optional="stretch",
    spread=0.3,
    time_constant=0.08,
    simulate=simulate,
    hidden=Hidden("backlash of the gear", "mm", 0.05, 10.0, ("backlash",)),
)
