"""A centrifugal pump on a throttle, its curve as a table of settled points; it can hide cavitation."""

from __future__ import annotations

import numpy as np

from rigctl.validation.benches.bench import Draw, Hidden, SmallBench, Trace

#: where the head begins to fall, m3/h
_LIMIT = 9.0


def simulate(draw: Draw) -> list[Trace]:
    """``H = suction + a·n² − b·q²``, the head that cavitation takes: ``amplitude·(q − limit)²`` above it."""
    height, loss = draw.about(22.0, 0.05), draw.about(0.09, 0.05)
    flow, speed = (grid.ravel() for grid in np.meshgrid(np.linspace(1.0, 12.0, 12), [0.85, 0.95, 1.0, 1.05]))
    flow = flow + 0.1 * draw.rng.uniform(-1.0, 1.0, flow.size)
    level = draw.optional(1.0, 0.3, float(flow.size))
    suction = np.array([level(float(row)) for row in range(flow.size)])
    head = suction + height * speed**2 - loss * flow**2
    head = head - draw.amplitude * np.maximum(flow - _LIMIT, 0.0) ** 2
    columns = {"flow": flow, "speed": speed, "suction": suction, "head": head}
    return [Trace(np.zeros(flow.size), columns)]


BENCH = SmallBench(
    name="pump",
    title="centrifugal pump, a table of settled points",
    columns={"flow": "m^3/h", "speed": "1", "suction": "m", "head": "m"},
    noise={"head": 0.05},
    optional="suction",
    spread=0.3,
    time_constant=None,
    simulate=simulate,
    hidden=Hidden("cavitation at large flow", "m/(m3/h)^2", 0.02, 2.0, ("threshold",)),
    hold_out="speed == 0.95",
)
