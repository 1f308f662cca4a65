"""A chamber that a valve fills with air through a capillary and another one empties; its seal can leak."""

from __future__ import annotations

from rigctl_validation.benches.bench import Draw, Floats, Hidden, Signal, SmallBench, Trace
from rigctl_validation.benches.motion import integrate, sampled, steps

#: openings of the filling valve and of the emptying valve, of the records
_FILL = (
    (1, 0, 0),
    (0.5, 0, 1),
    (1, 0.3, 0),
    (0.7, 0, 0),
    (0.4, 1, 0),
    (1, 0, 0),
    (0.8, 0, 0.5),
    (0.3, 0.6, 0),
)
_EMPTY = ((0, 0, 1), (0, 0.5, 0), (0, 0, 0.7), (0, 0, 0.4), (0, 0, 1), (0.3, 0, 0.2), (0, 1, 0), (0, 0, 0.5))
#: of free air
_LITRES_PER_MINUTE = 1e-3 / 60.0


def simulate(draw: Draw) -> list[Trace]:
    """``V·dp/dt = k_f·fill·(p_s² − p²) − k_e·empty·(p² − p_a²) − leak·(p − p_a)``, at one temperature."""
    volume, ambient = 1.0e-3, 1.013e5
    filling, emptying = draw.about(8e-10, 0.05), draw.about(6e-10, 0.05)
    time = draw.times(12.0)
    records = []
    for opened, vented in zip(_FILL, _EMPTY, strict=True):
        instants = draw.switches((0.5, 4.0, 8.0))
        fill, empty = steps(instants, opened), steps(instants, vented)
        supply = draw.optional(6.0, 0.4, 8.0)

        def rates(
            t: float, y: Floats, f: Signal = fill, e: Signal = empty, s: Signal = supply
        ) -> tuple[float]:
            inward = filling * f(t) * ((1e5 * s(t)) ** 2 - y[0] ** 2)
            outward = emptying * e(t) * (y[0] ** 2 - ambient**2)
            leak = draw.amplitude * _LITRES_PER_MINUTE * (y[0] - ambient)
            return ((inward - outward - leak) / volume,)

        states = integrate(rates, (1.5e5,), time, instants)
        records.append(
            Trace(
                time,
                {
                    "fill": sampled(fill, time),
                    "empty": sampled(empty, time),
                    "supply": sampled(supply, time),
                    "pressure": 1e-5 * states[:, 0],
                },
            )
        )
    return records


BENCH = SmallBench(
    name="chamber",
    title="pneumatic chamber",
    columns={"fill": "1", "empty": "1", "supply": "bar", "pressure": "bar"},
    noise={"pressure": 0.01},
    optional="supply",
    spread=0.4,
    time_constant=1.2,
    simulate=simulate,
    hidden=Hidden("a leak to the room", "l/min at 1 bar", 0.05, 30.0, ("leak_on_pressure",)),
)
