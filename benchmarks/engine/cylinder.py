"""The benchmark's model: a hydraulic cylinder with its pump and tank; 7 states, 28 parameters.

Frozen, and independent of the models that rigctl ships, so that results of different dates can be compared.
SI throughout.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from types import SimpleNamespace

import numpy as np

from rigctl.engine.excitation import Excitation
from rigctl.engine.symbols import Expr, exp, positive_part, sqrt, tanh
from rigctl.engine.system import System, SystemBuilder

AREA_CAP = math.pi / 4 * 0.05**2
AREA_ROD = AREA_CAP - math.pi / 4 * 0.025**2
STROKE = 0.25
BAR = 1e5

#: name: (unit, value, size); an effect is off at 0, and `size` is its typical value
NUISANCES: dict[str, tuple[str, float, float]] = {
    "pump_flow": ("m^3/s", 14 / 6e4, 14 / 6e4),
    "pump_leakage": ("m^3/s/Pa", 1e-12, 1e-12),
    "relief_gain": ("m^3/s/Pa", 4e-10, 4e-10),
    "valve_area": ("m^2", 4.5e-5 * math.sqrt(435 / BAR), 4.5e-5 * math.sqrt(435 / BAR)),
    "coulomb_force": ("N", 120.0, 120.0),
    "viscous_damping": ("N*s/m", 800.0, 800.0),
    "spool_time": ("s", 0.02, 0.02),
    "pressure_offset": ("Pa", 0.2 * BAR, BAR),
}
EFFECTS: dict[str, tuple[str, float, float]] = {
    "piston_leakage": ("m^3/s/Pa", 0.0, 2e-15),
    "cap_leakage": ("m^3/s/Pa", 0.0, 1e-15),
    "rod_leakage": ("m^3/s/Pa", 0.0, 1e-15),
    "barus": ("1/Pa", 0.0, 2e-8),
    "air_squared": ("Pa", 0.0, 100.0),
    "air": ("1", 0.0, 1e-4),
    "stribeck_force": ("N", 0.0, 60.0),
    "pressure_friction": ("N/Pa", 0.0, 3e-5),
    "hose_compliance": ("1/Pa", 0.0, 3e-10),
    "slip_thermal": ("m^3/s/Pa/K", 0.0, 1e-14),
    "slip_squared": ("m^3/s/Pa^2", 0.0, 2e-20),
    "relief_thermal": ("1", 0.0, 0.02),
    "relief_viscosity": ("Pa", 0.0, BAR),
    "area_thermal": ("1", 0.0, 0.1),
    "laminar_viscosity": ("1", 0.0, 0.5),
    "overlap": ("1", 0.0, 0.05),
    "overlap_asymmetry": ("1", 0.0, 0.05),
    "line_resistance": ("1/m", 0.0, 1e8),
    "constant_load": ("N", 0.0, 50.0),
    "spring_load": ("N/m", 0.0, 300.0),
}
PARAMETERS = NUISANCES | EFFECTS
STATES = {
    "temperature": ("K", 1e-3),
    "spool": ("1", 1e-4),
    "supply": ("Pa", 1e-2 * BAR),
    "pressure_cap": ("Pa", 1e-2 * BAR),
    "pressure_rod": ("Pa", 1e-2 * BAR),
    "position": ("m", 1e-5),
    "velocity": ("m/s", 1e-4),
}
INPUTS = {"valve": "1", "ambient": "K", "setting": "Pa", "heater": "W", "pump": "1"}


def build() -> System:  # noqa: PLR0915 - one model, read from top to bottom
    """The system, with the 20 effects at their null."""
    builder = SystemBuilder()
    c = builder.constant
    y = SimpleNamespace(**{name: builder.state(name, *rest) for name, rest in STATES.items()})
    u = SimpleNamespace(**{name: builder.input(name, unit) for name, unit in INPUTS.items()})
    q = SimpleNamespace(
        **{name: builder.parameter(name, unit, value) for name, (unit, value, _) in PARAMETERS.items()}
    )

    # the oil
    warm = y.temperature - c(313.15, "K")
    warmth = warm / c(40.0, "K")
    density = c(870.0, "kg/m^3") * (1 - c(0.0007, "1/K") * (y.temperature - c(288.15, "K")))
    vogel = exp(c(1132.5833, "K") / (y.temperature - c(147.4466, "K")))
    viscosity = c(3.1083e-5, "Pa*s") * vogel * exp(q.barus * 0.5 * (y.pressure_cap + y.pressure_rod))
    thickness = viscosity / c(0.030, "Pa*s")

    def compliance(pressure: Expr) -> Expr:
        inverse = 1 / (positive_part(pressure, 0.2 * BAR) + c(BAR, "Pa"))
        return c(1 / 1.4e9, "1/Pa") + q.hose_compliance + inverse * (q.air + q.air_squared * inverse)

    # the valve
    corner = c(0.3 * BAR, "Pa") * (1 + q.laminar_viscosity * (thickness - 1))
    corner = positive_part(corner, 0.02 * BAR)
    area = q.valve_area * (1 + q.area_thermal * warmth) * sqrt(2 / density)

    def orifice(opening: Expr, drop: Expr) -> Expr:
        return area * opening * drop / sqrt(sqrt(drop**2 + corner**2))

    forward = positive_part(y.spool - q.overlap * (1 + q.overlap_asymmetry) * 0.5, 1e-3)
    backward = positive_part(-y.spool - q.overlap * (1 - q.overlap_asymmetry) * 0.5, 1e-3)
    line = q.line_resistance * viscosity * y.velocity
    into_cap = orifice(forward, y.supply - y.pressure_cap - line)
    out_of_cap = orifice(backward, y.pressure_cap + line)
    into_rod = orifice(backward, y.supply - y.pressure_rod + 0.75 * line)
    out_of_rod = orifice(forward, y.pressure_rod - 0.75 * line)
    builder.equation("spool", (u.valve - y.spool) / q.spool_time)

    # pump and relief valve
    leaking = q.pump_leakage / thickness + q.slip_thermal * warm + q.slip_squared * y.supply
    delivered = u.pump * (q.pump_flow - leaking * y.supply)
    above = y.supply - u.setting * (1 + q.relief_thermal * warmth) - q.relief_viscosity * (thickness - 1)
    relief = q.relief_gain * positive_part(above, 0.3 * BAR)
    used = into_cap + into_rod + relief
    builder.equation("supply", (delivered - used) / (c(6e-4, "m^3") * compliance(y.supply)))

    # the chambers
    area_cap, area_rod = c(AREA_CAP, "m^2"), c(AREA_ROD, "m^2")
    dead_volume, stroke = c(1e-4, "m^3"), c(STROKE, "m")
    leakage = q.piston_leakage * (y.pressure_cap - y.pressure_rod) / thickness
    into_cap = into_cap - out_of_cap - area_cap * y.velocity - leakage
    into_cap = into_cap - q.cap_leakage * y.pressure_cap / thickness
    into_rod = into_rod - out_of_rod + area_rod * y.velocity + leakage
    into_rod = into_rod - q.rod_leakage * y.pressure_rod / thickness
    volume_cap = dead_volume + area_cap * y.position
    volume_rod = dead_volume + area_rod * (stroke - y.position)
    builder.equation("pressure_cap", into_cap / (volume_cap * compliance(y.pressure_cap)))
    builder.equation("pressure_rod", into_rod / (volume_rod * compliance(y.pressure_rod)))

    # the piston
    slow = y.velocity / c(4e-3, "m/s")
    seals = q.pressure_friction * positive_part(y.pressure_cap - y.pressure_rod, 0.5 * BAR)
    dry = (q.coulomb_force + q.stribeck_force * exp(-(slow**2) / 4) + seals) * tanh(slow)
    friction = dry + q.viscous_damping * thickness * y.velocity
    stiffness, damping = c(2e7, "N/m"), c(0.4, "s/m")
    far_end = stiffness * positive_part(y.position - stroke, 2e-5) * (1 + damping * y.velocity)
    near_end = stiffness * positive_part(-y.position, 2e-5) * (1 - damping * y.velocity)
    force = area_cap * y.pressure_cap - area_rod * y.pressure_rod - friction - far_end + near_end
    force = force - q.constant_load - q.spring_load * y.position
    builder.equation("position", y.velocity)
    builder.equation("velocity", force / c(20.0, "kg"))

    # the tank
    heat = u.heater + y.supply * delivered - c(12.0, "W/K") * (y.temperature - u.ambient)
    builder.equation("temperature", heat / (density * c(0.08, "m^3") * c(1900.0, "J/(kg*K)")))

    builder.output("temperature", "K", y.temperature)
    builder.output("supply", "Pa", y.supply + q.pressure_offset)
    builder.output("position", "m", y.position)
    builder.output("pressure_cap", "Pa", y.pressure_cap + q.pressure_offset)
    return builder.build()


SEGMENTS = ((2.5, 1.0), (2.0, 0.0), (2.5, -1.0))
RATE = 100.0
CONDITIONS = [(celsius, bar) for celsius in range(20, 51, 5) for bar in range(20, 51, 10)]


def campaign(parameters: Sequence[float] | None = None) -> list[Excitation]:
    """28 records of 7 s at 100 Hz: extend, hold, retract, at seven temperatures and four pressures."""
    switch_times = np.array([0.0, SEGMENTS[0][0], SEGMENTS[0][0] + SEGMENTS[1][0]])
    times = np.arange(int(sum(seconds for seconds, _ in SEGMENTS) * RATE) + 1) / RATE
    nominal = [value for _, value, _ in PARAMETERS.values()]
    values = np.array(nominal if parameters is None else parameters)
    records = []
    for celsius, bar in CONDITIONS:
        condition = [295.15, bar * BAR, 0.0, 1.0]
        inputs = np.array([[valve, *condition] for _, valve in SEGMENTS])
        initial = np.array([celsius + 273.15, 0.0, bar * BAR, 7.5 * BAR, 10 * BAR, 0.005, 0.0])
        name = f"{celsius} degC, {bar} bar"
        records.append(Excitation(times, switch_times, inputs, initial, values, name))
    return records
