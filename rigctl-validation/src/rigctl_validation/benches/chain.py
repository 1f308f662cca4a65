"""Three lumps of metal in a chain, heated at one end and cooled at the other; the middle may lose heat."""

from __future__ import annotations

from rigctl_validation.benches.bench import Draw, Floats, Hidden, Signal, SmallBench, Trace
from rigctl_validation.benches.motion import integrate, sampled, steps

#: W, of the records
_LEVELS = ((20, 5), (35, 0), (10, 30), (40, 20), (5, 15), (30, 10), (25, 0), (15, 40))


def simulate(draw: Draw) -> list[Trace]:
    """``C·dT1/dt = P − G·(T1 − T2)``, and so on; the last loses ``H·(T3 − room)``.

    Hidden: the middle loses ``amplitude·(T2 − room)``.
    """
    capacity = 120.0
    first, second, last = draw.about(0.8, 0.05), draw.about(0.7, 0.05), draw.about(0.9, 0.05)
    time = draw.times(1500.0)
    records = []
    for levels in _LEVELS:
        instants = draw.switches((30.0, 800.0))
        power = steps(instants, levels)
        room = draw.optional(21.0, 3.0, 1000.0)

        def rates(t: float, y: Floats, p: Signal = power, a: Signal = room) -> tuple[float, float, float]:
            one, two = first * (y[0] - y[1]), second * (y[1] - y[2])
            lost = draw.amplitude * (y[1] - a(t))
            return (
                (p(t) - one) / capacity,
                (one - two - lost) / capacity,
                (two - last * (y[2] - a(t))) / capacity,
            )

        states = integrate(rates, (room(0.0),) * 3, time, instants)
        records.append(
            Trace(
                time,
                {
                    "power": sampled(power, time),
                    "room": sampled(room, time),
                    "hot": states[:, 0],
                    "middle": states[:, 1],
                    "cold": states[:, 2],
                },
            )
        )
    return records


BENCH = SmallBench(
    name="chain",
    title="three lumps that conduct heat",
    columns={"power": "W", "room": "degC", "hot": "degC", "middle": "degC", "cold": "degC"},
    noise={"hot": 0.1, "middle": 0.1, "cold": 0.1},
    optional="room",
    spread=3.0,
    time_constant=100.0,
    simulate=simulate,
    hidden=Hidden("a loss of the middle to the room", "W/K", 2e-3, 0.5, ("leak_on_heat_middle",)),
)
