"""A small direct-current motor with a brake on its shaft; it can hide dry friction of its bearings."""

from __future__ import annotations

from rigctl_validation.benches.bench import Draw, Floats, Hidden, Signal, SmallBench, Trace
from rigctl_validation.benches.motion import sampled, steps, with_dry_friction

#: V, of the records
_LEVELS = ((6, 12, 0), (4, -8, 2), (12, 3, -6), (-10, 5, 0), (8, 10, -3), (2, -2, 7), (9, -4, 0), (-5, 11, 1))


def simulate(draw: Draw) -> list[Trace]:
    """``L·di/dt = u − R·i − k·w``, ``J·dw/dt = k·i − d·w − load − Tc·sign(w)``."""
    resistance, inductance = draw.about(1.2, 0.05), draw.about(3e-3, 0.1)
    constant, inertia, damping = draw.about(0.05, 0.03), draw.about(1.5e-4, 0.1), draw.about(1e-4, 0.2)
    time = draw.times(1.2)
    records = []
    for levels in _LEVELS:
        instants = draw.switches((0.1, 0.45, 0.8))
        voltage = steps(instants, levels)
        load = draw.optional(0.0, 0.006, 0.7)

        def rates(t: float, y: Floats, u: Signal = voltage, m: Signal = load) -> tuple[float, float]:
            current = (u(t) - resistance * y[0] - constant * y[1]) / inductance
            return current, (constant * y[0] - damping * y[1] - m(t)) / inertia

        states = with_dry_friction(
            rates, (0.0, 0.0), time, instants, velocity=1, friction=draw.amplitude / inertia
        )
        records.append(
            Trace(
                time,
                {
                    "voltage": sampled(voltage, time),
                    "load": sampled(load, time),
                    "current": states[:, 0],
                    "speed": states[:, 1],
                },
            )
        )
    return records


BENCH = SmallBench(
    name="motor",
    title="direct-current motor with a brake",
    columns={"voltage": "V", "load": "N*m", "current": "A", "speed": "rad/s"},
    noise={"current": 0.03, "speed": 0.5},
    optional="load",
    spread=0.006,
    time_constant=0.07,
    simulate=simulate,
    hidden=Hidden("dry friction of the bearings", "N*m", 2e-3, 0.05, ("coulomb_on_torque",)),
)
