"""A centrifugal pump on a throttle, its curve as a table of settled points; its flow meter may be off."""

from __future__ import annotations

import numpy as np

from rigctl_validation.benches.bench import Draw, Hidden, SmallBench, Trace


def simulate(draw: Draw) -> list[Trace]:
    """``H = suction + a·n² − b·q²``, q the flow that the meter shows and ``amplitude`` more."""
    height, loss = draw.about(22.0, 0.05), draw.about(0.09, 0.05)
    flow, speed = (grid.ravel() for grid in np.meshgrid(np.linspace(1.0, 12.0, 12), [0.85, 0.95, 1.0, 1.05]))
    flow = flow + 0.1 * draw.rng.uniform(-1.0, 1.0, flow.size)
    level = draw.optional(1.0, 0.3, float(flow.size))
    suction = np.array([level(float(row)) for row in range(flow.size)])
    head = suction + height * speed**2 - loss * (flow + draw.amplitude) ** 2
    columns = {"flow": flow, "speed": speed, "suction": suction, "head": head}
    return [Trace(np.zeros(flow.size), columns)]


BENCH = SmallBench(
    name="pump",
    title="centrifugal pump, a table of settled points",
    columns={"flow": "m^3/h", "speed": "1", "suction": "m", "head": "m"},
    noise={"head": 0.02},
    optional="suction",
    spread=0.3,
    time_constant=None,
    simulate=simulate,
    hidden=Hidden("a zero error of the flow meter", "m3/h", 0.3, 3.0, ("offset_of_flow",)),
    hold_out="speed == 0.95",
)
