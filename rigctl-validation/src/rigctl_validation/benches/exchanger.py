"""A heat exchanger as two stirred sides; it can hide a slow thermometer on the hot side."""

from __future__ import annotations

from rigctl_validation.benches.bench import Draw, Floats, Hidden, Signal, SmallBench, Trace
from rigctl_validation.benches.motion import integrate, sampled, steps

#: l/min of the hot side, of the records; the cold side has 4 l/min
_LEVELS = ((3, 6), (5, 2), (2, 7), (6, 3), (4, 1.5), (7, 4), (1.5, 5), (6.5, 2.5))
_KILOGRAMS = 1.0 / 60.0
_HEAT = 4180.0


def simulate(draw: Draw) -> list[Trace]:
    """``M·c·dT/dt = m·c·(T_in − T) ∓ UA·(T_hot − T_cold)``; the probe: ``dT_p/dt = (T_hot − T_p)/lag``."""
    mass = 1.0
    conductance, lag = draw.about(180.0, 0.05), draw.amplitude
    time = draw.times(240.0)
    records = []
    for levels in _LEVELS:
        instants = draw.switches((0.0, 20.0, 130.0))
        flow = steps(instants, (4.0, *levels))
        feed = draw.feed(70.0, 5.0, 150.0)
        cool = draw.optional(15.0, 3.0, 100.0)

        def rates(
            t: float, y: Floats, q: Signal = flow, f: Signal = feed, c: Signal = cool
        ) -> tuple[float, float, float]:
            through = conductance * (y[0] - y[1]) / (mass * _HEAT)
            return (
                _KILOGRAMS * q(t) * (f(t) - y[0]) / mass - through,
                _KILOGRAMS * 4.0 * (c(t) - y[1]) / mass + through,
                (y[0] - y[2]) / lag if lag else 0.0,
            )

        states = integrate(rates, (55.0, 25.0, 55.0), time, instants)
        records.append(
            Trace(
                time,
                {
                    "hot_flow": sampled(flow, time),
                    "hot_feed": sampled(feed, time),
                    "cold_feed": sampled(cool, time),
                    "hot": states[:, 2 if lag else 0],
                    "cold": states[:, 1],
                },
            )
        )
    return records


BENCH = SmallBench(
    name="exchanger",
    title="heat exchanger of two stirred sides",
    columns={"hot_flow": "l/min", "hot_feed": "degC", "cold_feed": "degC", "hot": "degC", "cold": "degC"},
    noise={"hot": 0.1, "cold": 0.1},
    optional="cold_feed",
    spread=3.0,
    time_constant=10.0,
    simulate=simulate,
    hidden=Hidden("a slow thermometer in the hot side", "s", 0.3, 20.0, ("lag_of_hot",)),
)
