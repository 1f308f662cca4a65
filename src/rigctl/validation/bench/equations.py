"""The right-hand side of the separate bench: the published model, written as plain numbers.

State: oil temperature T [K], spool u [1], supply pressure ps, chamber pressures pA, pB [Pa, gauge],
position x [m], speed v [m/s], then states that only secrets use: bristle z [m], pilot of the spool w [1],
oil temperature in cylinder and lines [K], temperature of the thermocouple [K], pressure at the transducer
[Pa]. Inputs: valve command, pressure setting [Pa], heater power [W], ambient temperature [K].

Sources: Merritt (1967) for orifices and chambers; Jelali & Kroll (2003) for air and friction; Canudas de Wit
et al., IEEE TAC 40(3) 1995, for LuGre; Viersma (1980) for the blended orifice.
"""

from __future__ import annotations

import math

from numba import njit

STATES = 12
T_OIL, SPOOL, PS, PA, PB, X, V, BRISTLE, PILOT, T_LINE, T_PROBE, P_PROBE = range(STATES)
#: what counts as small in each state, for the integrator's error control
SCALE = (0.1, 1e-3, 1e4, 1e4, 1e4, 1e-4, 1e-3, 1e-6, 1e-3, 0.1, 0.1, 1e4)

ATMOSPHERE = 1.01325e5  # Pa
VAPOUR = -0.7e5  # Pa gauge
ISENTROPIC = 1.4
SIGMA = 5.670374419e-8  # W/(m²·K⁴)
DRIFT_ORIGIN = 293.15  # K: drifts are counted from 20 °C


@njit(cache=True)
def root(dp):
    """sign(Δp)·√|Δp|, smooth below 1 kPa."""
    return dp / (dp * dp + 1e6) ** 0.25


@njit(cache=True)
def viscosity(t, p, b):
    """Vogel's law, times the pressure term if there is one."""
    law = b.vogel_a * math.exp(b.vogel_b / (t - b.vogel_c))
    return law * math.exp(b.barus * p / (1.0 + b.barus_fade * abs(p)))


@njit(cache=True)
def stiffness(p, b):
    """Bulk modulus of oil with isentropic free air and hoses; falls away where vapour forms."""
    absolute = max(p + ATMOSPHERE, 2e3)
    compliance = 1.0 / b.beta_oil
    if b.air > 0.0:
        volume = b.air * (ATMOSPHERE / absolute) ** (1.0 / ISENTROPIC)
        compliance = ((1.0 - b.air) * compliance + volume / (ISENTROPIC * absolute)) / (1.0 - b.air + volume)
    compliance += b.hose / (1.0 + max(p, 0.0) / 1e7)
    liquid = 1.0 / (1.0 + math.exp(-(p - VAPOUR) / 5e3))
    return (1e-4 + liquid) / compliance


@njit(cache=True)
def throttled(area, dp, rho, mu, b):
    """Flow through the throttle in series with an edge; blended towards laminar where that is hidden."""
    cd = b.cd
    if b.transition > 0.0:
        speed = math.sqrt(2.0 * abs(dp) / rho + 1e-6)
        reynolds = rho * speed * math.sqrt(4.0 * area / math.pi) / mu
        cd *= math.tanh((reynolds / b.transition) ** 0.7)
    return cd * area * math.sqrt(2.0 / rho) * root(dp)


@njit(cache=True)
def line_drop(flow, rho, mu, b):
    """Pressure lost in a working line: laminar, turbulent by Blasius above, and fittings."""
    if b.line_length == 0.0 and b.line_zeta == 0.0:
        return 0.0
    section = math.pi / 4.0 * b.line_bore**2
    speed = abs(flow) / section
    laminar = 32.0 * mu * b.line_length * speed / b.line_bore**2
    reynolds = rho * speed * b.line_bore / mu + 1e-9
    turbulent = 0.3164 * reynolds**-0.25 * b.line_length / b.line_bore * rho * speed * speed / 2.0
    loss = (laminar**4 + turbulent**4) ** 0.25 + b.line_zeta * rho * speed * speed / 2.0
    return math.copysign(loss, flow)


@njit(cache=True)
def spool_leakage(dp, mu, rho, b):
    """One port of the spool: a laminar gap with a share that behaves as an orifice."""
    if b.spool_leak == 0.0:
        return 0.0
    laminar = b.spool_leak * dp / mu
    reference = b.spool_leak * 3e6 / 0.0289
    orifice = reference * root(dp) / math.sqrt(3e6) * math.sqrt(870.0 / rho)
    return (1.0 - b.spool_leak_turbulent) * laminar + b.spool_leak_turbulent * orifice


@njit(cache=True)
def friction(v, z, p_a, p_b, b):
    """LuGre: returns the force and dz/dt. Sliding force, Stribeck excess and seals share one bristle."""
    sliding = b.coulomb + b.seal_friction * (max(p_a, 0.0) + max(p_b, 0.0))
    level = sliding + b.static * math.exp(-((v / b.stribeck_speed) ** 2))
    if level <= 0.0:
        return 0.0, -z
    slip = v - b.bristle * abs(v) * z / level
    return b.bristle * z + 2.0 * math.sqrt(b.bristle) * slip, slip


@njit(cache=True)
def rhs(y, inputs, b, f):  # noqa: PLR0915 - one bench, one right-hand side, read from top to bottom
    """Write dy/dt into `f`."""
    command, setting, heat, ambient = inputs[0], inputs[1], inputs[2], inputs[3]
    ps, p_a, p_b, x, v, u = y[PS], y[PA], y[PB], y[X], y[V], y[SPOOL]
    t = y[T_LINE] if b.line_lag > 0.0 else y[T_OIL]
    rho = b.rho15 * (1.0 - b.expansion * (t - 288.15))
    mu = viscosity(t, 0.5 * (p_a + p_b), b)

    edge = b.edge_area * abs(u)
    throttle = b.throttle_area * (1.0 + b.throttle_drift * (t - DRIFT_ORIGIN))
    series = throttle * edge / math.sqrt(throttle * throttle + edge * edge + 1e-20)
    out_a = line_drop(b.area_a * v, rho, mu, b)
    out_b = line_drop(b.area_b * v, rho, mu, b)
    q_pa = q_at = q_pb = q_bt = 0.0
    if u > 0.0:
        q_pa = throttled(series, ps - p_a - out_a, rho, mu, b)
        q_bt = b.cd * edge * math.sqrt(2.0 / rho) * root(p_b - out_b)
    else:
        q_pb = throttled(series, ps - p_b + out_b, rho, mu, b)
        q_at = b.cd * edge * math.sqrt(2.0 / rho) * root(p_a + out_a)

    gap = (
        math.pi * 0.050 * b.piston_gap**3 / (12.0 * b.piston_length) * (1.0 + 1.5 * b.piston_eccentricity**2)
    )
    q_ab = gap * (p_a - p_b) / mu
    leak_pa, leak_pb = spool_leakage(ps - p_a, mu, rho, b), spool_leakage(ps - p_b, mu, rho, b)
    leak_at, leak_bt = spool_leakage(p_a, mu, rho, b), spool_leakage(p_b, mu, rho, b)
    into_a = q_pa - q_at - b.area_a * v - q_ab + leak_pa - leak_at - b.cap_leak * p_a / mu
    into_b = q_pb - q_bt + b.area_b * v + q_ab + leak_pb - leak_bt - b.rod_leak * p_b / mu

    wanted = setting * (1.0 + b.relief_drift * (t - DRIFT_ORIGIN))
    full = b.pump_flow
    resistance = b.relief_r + b.relief_extra_r / (1.0 + abs(ps - wanted) / 2e5)
    relief = max(0.0, full + (ps - wanted) / resistance)
    out_of_p = q_pa + q_pb + leak_pa + leak_pb + relief + b.pump_slip * ps / mu

    f[PA] = stiffness(p_a, b) / (b.dead_a + b.area_a * x) * into_a
    f[PB] = stiffness(p_b, b) / (b.dead_b + b.area_b * (b.stroke - x)) * into_b
    f[PS] = stiffness(ps, b) / b.line_volume * (full - out_of_p)

    rub, f[BRISTLE] = friction(v, y[BRISTLE], p_a, p_b, b)
    stop = 0.0
    if x < 0.0:
        stop = max(0.0, -b.stop_stiffness * x - b.stop_damping * v)
    elif x > b.stroke:
        stop = min(0.0, -b.stop_stiffness * (x - b.stroke) - b.stop_damping * v)
    force = b.area_a * p_a - b.area_b * p_b - b.damping * v - b.film * mu * v - rub + stop
    force -= b.constant_load + b.spring * x
    f[X] = v
    f[V] = force / (b.mass + b.load_mass)

    if b.spool_second > 0.0:
        f[PILOT] = (command - y[PILOT]) / b.spool_second
        f[SPOOL] = (y[PILOT] - u) / b.spool_time
    else:
        f[PILOT] = command - y[PILOT]
        f[SPOOL] = (command - u) / b.spool_time

    capacity = rho * b.tank_volume * b.cp + b.wall_capacity
    gain = heat + ps * full / b.efficiency
    gain -= (b.area_a * p_a - b.area_b * p_b) * v
    gain -= b.loss * (y[T_OIL] - ambient) + b.radiation * SIGMA * (y[T_OIL] ** 4 - ambient**4)
    f[T_OIL] = gain / capacity
    f[T_LINE] = (y[T_OIL] - y[T_LINE]) / b.line_lag if b.line_lag > 0.0 else f[T_OIL]
    f[T_PROBE] = (y[T_OIL] - y[T_PROBE]) / b.thermocouple_time if b.thermocouple_time > 0.0 else f[T_OIL]
    f[P_PROBE] = (ps - y[P_PROBE]) / b.pressure_time if b.pressure_time > 0.0 else f[PS]
