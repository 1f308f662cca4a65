"""The ten moving twins by name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from rigctl.errors import unknown_name
from rigctl_validation.benches.bench import Floats
from rigctl_validation.benches.register import find_bench
from rigctl_validation.moving_benches.twin import Drawn, Driven, MovingHidden, Twin, columns

#: SI value of 1 l/min at 1 bar against a volume of one litre: the rate of a leak in 1/s for each l/min
_LEAK = 1e-3 / 60.0 / 1e-3
_MASS = 1.5


def _motor(y: Floats, w: Floats, p: Floats, a: Floats) -> dict[str, Floats]:
    return columns(("current", "speed"), y)


def _tanks(y: Floats, w: Floats, p: Floats, a: Floats) -> dict[str, Floats]:
    return columns(("level_1", "level_2"), 1e3 * y)


def _spring(y: Floats, w: Floats, p: Floats, a: Floats) -> dict[str, Floats]:
    return {"position": 1e3 * y[:, 0]}


def _pendulum(y: Floats, w: Floats, p: Floats, a: Floats) -> dict[str, Floats]:
    return {"angle": np.degrees(y[:, 0])}


def _chain(y: Floats, w: Floats, p: Floats, a: Floats) -> dict[str, Floats]:
    return columns(("hot", "middle", "cold"), y)


def _exchanger(y: Floats, w: Floats, p: Floats, a: Floats) -> dict[str, Floats]:
    return {"hot": y[:, 2 if a[0] else 0], "cold": y[:, 1]}


def _chamber(y: Floats, w: Floats, p: Floats, a: Floats) -> dict[str, Floats]:
    return {"pressure": 1e-5 * y[:, 0]}


def _battery(y: Floats, w: Floats, p: Floats, a: Floats) -> dict[str, Floats]:
    source = 3.0 + 0.9 * y[:, 0] + 0.3 * np.tanh(y[:, 0] / 0.1)
    return {"voltage": source - p[0] * (1.0 - 0.01 * (w[:, 1] - 25.0)) * w[:, 0] - y[:, 1]}


def _belt(y: Floats, w: Floats, p: Floats, a: Floats) -> dict[str, Floats]:
    return {"angle": y[:, 0], "carriage": y[:, 3]}


def _pump(y: Floats, w: Floats, p: Floats, a: Floats) -> dict[str, Floats]:
    return {"head": w[:, 2] + p[0] * w[:, 1] ** 2 - p[1] * (w[:, 0] + a[0]) ** 2}


_TWINS = (
    Twin(
        find_bench("motor"),
        (
            Drawn("resistance", 1.2, 0.05),
            Drawn("inductance", 3e-3, 0.1),
            Drawn("motor_constant", 0.05, 0.03),
            Drawn("inertia", 1.5e-4, 0.1),
            Drawn("damping", 1e-4, 0.2),
        ),
        (Driven("voltage", 0.0, 10.0), Driven("load", 0.0, 0.006, held=False, excited=False)),
        (MovingHidden("dry friction", 0, 2e-3, 0.05, ("coulomb_on_torque",), ("coulomb_on_torque", "size")),),
        (0.0, 0.0),
        ((0,), (1,)),
        _motor,
        released=(0.0, 150.0),
        decay=0.2,
        limits={"current": 15.0, "speed": 300.0},
    ),
    Twin(
        find_bench("tanks"),
        (Drawn("orifice_1", 5.0e-5, 0.05), Drawn("orifice_2", 5.5e-5, 0.05)),
        (Driven("pump", 6.0, 1.5, rest=0.0), Driven("rain", 0.5, 0.3, held=False, excited=False)),
        (MovingHidden("overflow", 0, 0.05, 5.0, ("threshold_on_level_1",)),),
        (0.10, 0.10),
        ((0,), (1,)),
        _tanks,
        released=(0.35, 0.15),
        decay=80.0,
        limits={"level_1": 450.0, "level_2": 450.0},
    ),
    Twin(
        find_bench("spring"),
        (Drawn("stiffness", 600.0, 0.05), Drawn("damping", 2.5, 0.2)),
        (Driven("drive", 0.0, 20.0), Driven("push", 0.0, 2.0, held=False, excited=False)),
        (
            MovingHidden(
                "dry friction",
                0,
                0.1,
                6.0,
                ("coulomb_on_velocity",),
                ("coulomb_on_velocity", "size"),
                lambda force, _: force / _MASS,
            ),
            MovingHidden(
                "cubic stiffness",
                1,
                2e4,
                2e6,
                ("cubic_stiffness_on_velocity",),
                ("cubic_stiffness_on_velocity", "coefficient"),
                lambda cubic, _: cubic / _MASS,
            ),
        ),
        (0.0, 0.0),
        ((0,),),
        _spring,
        released=(0.06, 0.0),
        decay=2.0,
        limits={"position": 100.0},
    ),
    Twin(
        find_bench("pendulum"),
        (Drawn("inertia", 0.20, 0.05), Drawn("damping", 0.02, 0.2)),
        (Driven("torque", 0.0, 1.2), Driven("tilt", 0.0, 1.5, held=False, excited=False)),
        (
            MovingHidden(
                "drag of the air",
                0,
                2e-3,
                0.2,
                ("quadratic_drag_on_velocity",),
                ("quadratic_drag_on_velocity", "coefficient"),
                lambda drag, p: drag / float(p[0]),
            ),
            MovingHidden(
                "dry friction",
                1,
                5e-3,
                0.3,
                ("coulomb_on_velocity",),
                ("coulomb_on_velocity", "size"),
                lambda torque, p: torque / float(p[0]),
            ),
        ),
        (0.0, 0.0),
        ((0,),),
        _pendulum,
        released=(1.2, 0.0),
        decay=16.0,
        limits={"angle": 100.0},
    ),
    Twin(
        find_bench("chain"),
        (Drawn("conductance_1", 0.8, 0.05), Drawn("conductance_2", 0.7, 0.05), Drawn("loss", 0.9, 0.05)),
        (Driven("power", 20.0, 20.0, rest=0.0), Driven("room", 21.0, 3.0, held=False, excited=False)),
        (
            MovingHidden(
                "a loss of the middle",
                0,
                2e-3,
                0.5,
                ("leak_on_heat_middle",),
                ("leak_on_heat_middle", "coefficient"),
            ),
        ),
        (21.0, 21.0, 21.0),
        ((0,), (1,), (2,)),
        _chain,
        released=(90.0, 60.0, 40.0),
        decay=400.0,
    ),
    Twin(
        find_bench("exchanger"),
        (Drawn("conductance", 180.0, 0.05),),
        (
            Driven("hot_flow", 4.25, 2.75),
            Driven("hot_feed", 70.0, 5.0, held=False, excited=False),
            Driven("cold_feed", 15.0, 3.0, held=False, excited=False),
        ),
        (
            MovingHidden(
                "a slow thermometer",
                0,
                0.3,
                20.0,
                ("lag_of_hot",),
                ("lag_of_hot", "lag"),
                only=("multisine", "prbs", "sine"),
            ),
        ),
        (55.0, 25.0, 55.0),
        ((0, 2), (1,)),
        _exchanger,
    ),
    Twin(
        find_bench("chamber"),
        (Drawn("filling", 8e-10, 0.05), Drawn("emptying", 6e-10, 0.05)),
        (
            Driven("fill", 0.55, 0.45, rest=0.0),
            Driven("empty", 0.5, 0.4, rest=0.3),
            Driven("supply", 6.0, 0.4, held=False, excited=False),
        ),
        (
            MovingHidden(
                "a leak",
                0,
                0.05,
                30.0,
                ("leak_on_pressure",),
                ("leak_on_pressure", "coefficient"),
                lambda leak, _: leak * _LEAK,
            ),
        ),
        (1.5e5,),
        ((0,),),
        _chamber,
        released=(5.5e5,),
        decay=8.0,
    ),
    Twin(
        find_bench("pump"),
        (Drawn("height", 22.0, 0.05), Drawn("resistance", 0.09, 0.05, 3600.0**2)),
        (
            Driven("flow", 6.5, 5.5, held=False),
            Driven("speed", 0.95, 0.1, held=False),
            Driven("suction", 1.0, 0.3, held=False, excited=False),
        ),
        (
            MovingHidden(
                "a zero error of the flow meter",
                0,
                0.3,
                3.0,
                ("offset_of_flow",),
                ("offset_of_flow", "size"),
                lambda flow, _: flow / 3600.0,
            ),
        ),
        (),
        (),
        _pump,
    ),
    Twin(
        find_bench("battery"),
        (
            Drawn("resistance_0", 0.05, 0.1),
            Drawn("resistance_1", 0.03, 0.1),
            Drawn("capacitance", 1500.0, 0.1),
        ),
        (Driven("current", 0.3, 2.5), Driven("warmth", 25.0, 4.0, held=False, excited=False)),
        (
            MovingHidden(
                "discharge by itself",
                0,
                0.05,
                2.0,
                ("leak_on_charge", "offset_on_charge"),
                ("offset_on_charge", "size"),
                lambda current, _: -current / 7200.0,
            ),
        ),
        (0.9, 0.0),
        (),
        _battery,
    ),
    Twin(
        find_bench("belt"),
        (Drawn("lag", 0.08, 0.1), Drawn("radius", 20.0, 0.03, 1e-3)),
        (Driven("drive", 0.0, 8.0), Driven("warmth", 25.0, 5.0, held=False, excited=False)),
        (MovingHidden("backlash of the gear", 0, 0.1, 10.0, ("hysteresis_of_carriage",)),),
        (0.0, 0.0, 0.0, 0.0),
        ((0,), (2, 3)),
        _belt,
        limits={"angle": 15.0, "carriage": 400.0},
    ),
)

TWINS: Final[Mapping[str, Twin]] = {twin.name: twin for twin in _TWINS}


def find_twin(name: str) -> Twin:
    """The twin of this name.

    Raises
    ------
    RigctlError
        there is none.
    """
    if name not in TWINS:
        raise unknown_name("moving bench", name, TWINS)
    return TWINS[name]
