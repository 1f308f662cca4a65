"""Parameters of the separate bench, with the effects that can be hidden in it.

Plain floats in a named tuple, which numba compiles against; every hidden term is off at its default.
All values are SI.
"""

from __future__ import annotations

import math
from typing import NamedTuple


class BenchParameters(NamedTuple):
    """The published bench; the fields after `base ends` are hidden effects, exactly off at their defaults."""

    # geometry
    area_a: float = math.pi / 4 * 0.050**2  # m²
    area_b: float = math.pi / 4 * (0.050**2 - 0.025**2)  # m²
    stroke: float = 0.250  # m
    dead_a: float = 60e-6  # m³
    dead_b: float = 60e-6  # m³
    line_volume: float = 400e-6  # m³
    throttle_area: float = 3.3e-6  # m²
    edge_area: float = 28e-6  # m²
    # oil HL32
    rho15: float = 870.0  # kg/m³
    expansion: float = 7e-4  # 1/K
    vogel_a: float = 3.1083e-5  # Pa·s
    vogel_b: float = 1132.5833  # K
    vogel_c: float = 147.4466  # K
    beta_oil: float = 1.4e9  # Pa
    cp: float = 1900.0  # J/(kg·K)
    # machine
    cd: float = 0.62
    mass: float = 12.0  # kg
    damping: float = 120.0  # N·s/m
    spool_time: float = 0.025  # s
    pump_flow: float = 14e-3 / 60  # m³/s
    relief_r: float = 2e8  # Pa/(m³/s)
    stop_stiffness: float = 2e8  # N/m
    stop_damping: float = 1e5  # N·s/m
    tank_volume: float = 0.080  # m³
    loss: float = 12.0  # W/K
    efficiency: float = 0.9
    pump_heat: float = 1.0  # share of the pump's power that warms the oil
    # --- base ends: hidden effects below
    # leakages
    piston_gap: float = 0.0  # m, radial clearance of the piston
    piston_length: float = 0.020  # m
    piston_eccentricity: float = 0.7  # 0 centred … 1 touching: the flow grows by 1 + 1.5 e²
    piston_opening: float = 0.0  # 1/Pa, growth of the gap with the pressure difference
    spool_leak: float = 0.0  # m³, each port
    spool_leak_turbulent: float = 0.15  # share of it that behaves as a small orifice at 30 bar, 40 °C
    cap_leak: float = 0.0  # m³
    rod_leak: float = 0.0  # m³
    seal_leak_turbulent: float = 0.1  # the same share of the last two
    pump_slip: float = 0.0  # m³
    slip_turbulent: float = 0.1  # the same share of the pump's slip
    # supply
    relief_extra_r: float = 0.0  # Pa/(m³/s)
    relief_soft: float = 2e5  # Pa: deviation from the setting at which half of it is left
    relief_drift: float = 0.0  # 1/K, of the setting
    # orifices and lines
    transition: float = 0.0  # Re_t of the throttle: Cd/√(1 + 2·(Re_t/Re)^n)
    transition_power: float = 0.8  # n; a short tube (Merritt, section 3-4) has ½
    throttle_drift: float = 0.0  # 1/K
    drift_fade: float = 0.003  # 1/K: thermal drifts of valves level off, ΔT/(1 + fade·|ΔT|)
    line_length: float = 0.0  # m, of the working lines
    line_bore: float = 0.010  # m
    line_zeta: float = 0.0
    # oil
    barus: float = 0.0  # 1/Pa
    barus_fade: float = 4e-10  # 1/Pa: the coefficient falls with pressure, as measured oils do
    air: float = 0.0  # free-air fraction at atmospheric pressure
    air_exponent: float = 1.25  # polytropic, between slow (1) and isentropic (1.4)
    air_dissolving: float = 0.0  # 1/Pa: of the free air 1/(1 + this·p) is left
    hose: float = 0.0  # 1/Pa, compliance at no pressure
    hose_stiffening: float = 1e7  # Pa: where half of the compliance is left
    # forces
    coulomb: float = 0.0  # N, LuGre with its static force equal to the sliding one
    static: float = 0.0  # N above `coulomb`, LuGre
    stribeck_speed: float = 0.015  # m/s
    bristle: float = 2e6  # N/m
    film: float = 0.0  # m, area over thickness of the oil film: force = film·μ·v
    film_thinning: float = 1.0  # s/m: the force is divided by 1 + this·|v|
    seal_friction: float = 0.0  # N/Pa, grows with chamber pressure, LuGre
    load_mass: float = 0.0  # kg
    spring: float = 0.0  # N/m
    spring_progress: float = 1.0  # 1/m: the stiffness grows by 1 + this·x
    constant_load: float = 0.0  # N
    # command
    spool_second: float = 0.0  # s, a second lag of the spool
    # heat
    line_share: float = 0.0  # initial share of the way to room temperature, oil in cylinder and lines
    line_mixing: float = 2e-3  # m³ in which oil from the tank then mixes with it
    wall_capacity: float = 0.0  # J/K, moves with the oil
    radiation: float = 0.0  # m², emissivity times area
    # sensors
    thermocouple_time: float = 0.0  # s
    pressure_time: float = 0.0  # s
    pressure_time_viscous: float = 0.0  # share of it that goes with the viscosity, as in a damping nozzle
    # forces that are in no library; bumps are 15 mm wide
    groove: float = 0.0  # N, holds the piston about 60 mm
    scuff: float = 0.0  # N, dry friction about 60 mm
    tight: float = 0.0  # N at 0.1 m/s, drag about 60 mm
    cushion: float = 0.0  # N at 0.1 m/s and 120 mm; begins at 70 mm
    cold_seal: float = 0.0  # N, dry friction at 20 °C; a third of it at 45 °C
    half_drag: float = 0.0  # N at 0.1 m/s, with √v
    cube_drag: float = 0.0  # N at 0.1 m/s, with v³
    bent_rod: float = 0.0  # N at 120 mm, dry friction in proportion to the way out
    rubber: float = 0.0  # N at 120 mm; a third of it 30 mm before
    grip: float = 0.0  # N, dry friction that is gone above 30 mm/s
    diaphragm: float = 0.0  # N at 3 MPa, with the square of pA
    score: float = 0.0  # m³/s at 3 MPa, past the piston about 60 mm, in proportion to the difference
    nozzle_a: float = 0.0  # m³/s at 3 MPa, cap side to tank, with √p
    nozzle_b: float = 0.0  # m³/s at 3 MPa, rod side to outside, with √p
    crack_a: float = 0.0  # m³/s, cap side to tank, for each 3 MPa above 0.5 MPa
    lip_a: float = 0.0  # m³/s at 3 MPa, cap side to tank, with p²
    lip_ab: float = 0.0  # m³/s at 3 MPa, past the piston, with Δp²
    lip_p: float = 0.0  # m³/s at 3 MPa, pump to tank, with p²
    warm_slip: float = 0.0  # m³/s at 3 MPa and 40 °C, pump to tank, in proportion to p and to T − 20 °C

    def in_floats(self) -> BenchParameters:
        """The bench with floats only: integers would cause another compilation."""
        return BenchParameters(*map(float, self))


class Sensors(NamedTuple):
    """Errors of the bench's sensors; none at the defaults."""

    position_gain: float = 0.0
    position_bow: float = 0.0  # 1/m: the error of the gain grows by 1 + this·x
    position_offset: float = 0.0  # m
    position_drift: float = 0.0  # 1/K from 20 °C, of the gain
    position_drift_fade: float = 0.003  # 1/K: it levels off, ΔT/(1 + fade·|ΔT|)
    position_backlash: float = 0.0  # m, the whole play
    pressure_gain: float = 0.0
    pressure_offset: float = 0.0  # Pa
    pressure_offset_warming: float = 0.0  # 1/K from 20 °C: the offset grows by 1 + this·ΔT
    thermocouple_offset: float = 0.0  # K
    # errors that are in no library
    dented_scale: float = 0.0  # m, about 60 mm
    root_scale: float = 0.0  # m at 100 mm, with √x
    soft_transducer: float = 0.0  # Pa at 3 MPa, with p²


class Switching(NamedTuple):
    """Delays of the directional valve; `jitter` is drawn for each switch."""

    open_delay: float = 0.0  # s
    close_delay: float = 0.0  # s
    delay_per_kelvin: float = 0.0  # s/K from 20 °C, of opening
    delay_fade: float = 0.003  # 1/K: it levels off, ΔT/(1 + fade·|ΔT|)
    jitter: float = 0.0  # s, standard deviation
    jitter_share: float = 0.0  # of the delay, added to it

    @property
    def random(self) -> bool:
        """True when no two switches are alike."""
        return self.jitter != 0.0 or self.jitter_share != 0.0
