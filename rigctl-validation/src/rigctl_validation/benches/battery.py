"""A lithium cell as a circuit of two resistors and a capacitor; it can hide self-discharge."""

from __future__ import annotations

import math

from rigctl_validation.benches.bench import Draw, Floats, Hidden, Signal, SmallBench, Trace
from rigctl_validation.benches.motion import integrate, sampled, steps

#: A, of the records; positive discharges
_LEVELS = (
    (2, 0, 1),
    (3, -1, 0),
    (1, 2, 0),
    (-1, 3, 1),
    (2.5, 0, 2),
    (0.5, 3, -1),
    (2, 1, 0),
    (1.5, -0.5, 2.5),
)


def simulate(draw: Draw) -> list[Trace]:
    """``dq/dt = −(i + i_self)/Q``, ``C1·dv1/dt = i − v1/R1``, ``v = ocv(q) − R0·i − v1``.

    ``ocv = 3.0 V + 0.9 V·q + 0.3 V·tanh(q/0.1)``; R0 falls by 1 % per kelvin.
    """
    charge, series = 2.0 * 3600.0, draw.about(0.05, 0.1)
    resistance, capacity = draw.about(0.03, 0.1), draw.about(1500.0, 0.1)
    time = draw.times(2400.0)
    records = []
    for levels in _LEVELS:
        instants = draw.switches((60.0, 700.0, 1500.0))
        current = steps(instants, levels)
        warmth = draw.optional(25.0, 4.0, 2000.0)

        def rates(t: float, y: Floats, i: Signal = current) -> tuple[float, float]:
            return -(i(t) + draw.amplitude) / charge, float((i(t) - y[1] / resistance) / capacity)

        states = integrate(rates, (0.9, 0.0), time, instants)
        drawn, warm = sampled(current, time), sampled(warmth, time)
        ocv = [3.0 + 0.9 * q + 0.3 * math.tanh(q / 0.1) for q in states[:, 0]]
        shown = ocv - series * (1.0 - 0.01 * (warm - 25.0)) * drawn - states[:, 1]
        records.append(Trace(time, {"current": drawn, "warmth": warm, "voltage": shown}))
    return records


BENCH = SmallBench(
    name="battery",
    title="lithium cell",
    columns={"current": "A", "warmth": "degC", "voltage": "V"},
    noise={"voltage": 2e-3},
    optional="warmth",
    spread=4.0,
    time_constant=45.0,
    simulate=simulate,
    hidden=Hidden("discharge by itself", "A", 5e-3, 1.0, ("leak_on_charge", "offset_on_charge")),
)
