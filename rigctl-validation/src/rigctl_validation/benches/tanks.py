"""Two tanks in a row, the first fed by a pump and both by rain; it can hide an overflow of the first."""

from __future__ import annotations

import math

from rigctl_validation.benches.bench import Draw, Floats, Hidden, Signal, SmallBench, Trace
from rigctl_validation.benches.motion import integrate, sampled, steps

#: l/min, of the records
_LEVELS = ((5, 3), (7.5, 3), (6.5, 4), (4, 7.5), (3, 6), (7, 7.5), (7.5, 3), (4, 5))
_LITRES_PER_MINUTE = 1e-3 / 60.0
_GRAVITY = 9.80665
#: height of the first tank's overflow pipe, m
_RIM = 0.20


def simulate(draw: Draw) -> list[Trace]:
    """``A1·dh1/dt = q − a1·√(2g·h1) − overflow``, ``A2·dh2/dt = a1·√(2g·h1) + rain − a2·√(2g·h2)``.

    The overflow is that of a weir: ``amplitude·((h1 − rim)/10 mm)^1.5``.
    """
    first, second = 0.020, 0.020
    upper, lower = draw.about(5.0e-5, 0.05), draw.about(5.5e-5, 0.05)
    time = draw.times(900.0)
    records = []
    for levels in _LEVELS:
        instants = draw.switches((20.0, 500.0))
        pump = steps(instants, levels)
        rain = draw.optional(0.5, 0.3, 400.0)

        def rates(t: float, y: Floats, q: Signal = pump, r: Signal = rain) -> tuple[float, float]:
            between = upper * math.sqrt(2.0 * _GRAVITY * max(y[0], 0.0))
            out = lower * math.sqrt(2.0 * _GRAVITY * max(y[1], 0.0))
            over = draw.amplitude * _LITRES_PER_MINUTE * (max(y[0] - _RIM, 0.0) / 0.010) ** 1.5
            return (
                (q(t) * _LITRES_PER_MINUTE - between - over) / first,
                (between + r(t) * _LITRES_PER_MINUTE - out) / second,
            )

        states = integrate(rates, (0.10, 0.10), time, instants)
        records.append(
            Trace(
                time,
                {
                    "pump": sampled(pump, time),
                    "rain": sampled(rain, time),
                    "level_1": 1e3 * states[:, 0],
                    "level_2": 1e3 * states[:, 1],
                },
            )
        )
    return records


BENCH = SmallBench(
    name="tanks",
    title="two tanks in a row",
    columns={"pump": "l/min", "rain": "l/min", "level_1": "mm", "level_2": "mm"},
    noise={"level_1": 1.0, "level_2": 1.0},
    optional="rain",
    spread=0.3,
    time_constant=100.0,
    simulate=simulate,
    hidden=Hidden("an overflow of the first tank", "l/min at 10 mm", 0.05, 5.0, ("threshold_on_level_1",)),
)
