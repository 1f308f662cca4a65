"""A mass on a spring whose other end is moved; it can hide dry friction of its guide."""

from __future__ import annotations

from rigctl_validation.benches.bench import Draw, Floats, Hidden, Signal, SmallBench, Trace
from rigctl_validation.benches.motion import sampled, steps, with_dry_friction

#: mm, of the records
_LEVELS = ((20, -10), (35, 5), (-25, 10), (10, 40), (-40, 0), (15, -30), (5, 25), (-15, 20))


def simulate(draw: Draw) -> list[Trace]:
    """``m·dv/dt = k·(u − x) − c·v + push − Fc·sign(v)``."""
    mass, stiffness, damping = 1.5, draw.about(600.0, 0.05), draw.about(2.5, 0.2)
    time = draw.times(3.0)
    records = []
    for levels in _LEVELS:
        instants = draw.switches((0.2, 1.6))
        drive = steps(instants, levels)
        push = draw.optional(0.0, 2.0, 2.0)

        def rates(t: float, y: Floats, u: Signal = drive, f: Signal = push) -> tuple[float, float]:
            force = stiffness * (1e-3 * u(t) - y[0]) - damping * y[1] + f(t)
            return float(y[1]), force / mass

        states = with_dry_friction(
            rates, (push(0.0) / stiffness, 0.0), time, instants, velocity=1, friction=draw.amplitude / mass
        )
        records.append(
            Trace(
                time,
                {
                    "drive": sampled(drive, time),
                    "push": sampled(push, time),
                    "position": 1e3 * states[:, 0],
                },
            )
        )
    return records


BENCH = SmallBench(
    name="spring",
    title="mass on a spring",
    columns={"drive": "mm", "push": "N", "position": "mm"},
    noise={"position": 0.1},
    optional="push",
    spread=2.0,
    time_constant=0.05,
    simulate=simulate,
    hidden=Hidden("dry friction of the guide", "N", 0.1, 6.0, ("coulomb_on_velocity",)),
)
