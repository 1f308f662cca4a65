"""The right-hand side of the separate bench: the published model, written as plain numbers.

State: oil temperature T [K], spool u [1], supply pressure ps, chamber pressures pA, pB [Pa, gauge],
position x [m], speed v [m/s], then states of hidden effects only: bristle z [m], pilot of the spool w [1],
oil temperature in cylinder and lines [K], temperature of the thermocouple [K], pressure at the transducer
[Pa]. Inputs: valve command, pressure setting [Pa], heater power [W], ambient temperature [K].

Sources: Merritt (1967) for orifices and chambers; Jelali & Kroll (2003) for air and friction; Canudas de Wit
et al., IEEE TAC 40(3) 1995, for LuGre.
"""

from __future__ import annotations

import math

from numba import njit

from rigctl_validation.bench.compiled import compiled

STATES = 12
T_OIL, SPOOL, PS, PA, PB, X, V, BRISTLE, PILOT, T_LINE, T_PROBE, P_PROBE = range(STATES)
#: absolute tolerance of each state, for the integrator's error control
SCALE = (0.1, 1e-3, 1e4, 1e4, 1e4, 1e-4, 1e-3, 1e-6, 1e-3, 0.1, 0.1, 1e4)

ATMOSPHERE = 1.01325e5  # Pa
VAPOUR = -0.7e5  # Pa gauge
CONTACT = 2e-6  # m, over which the contact of an end stop is smoothed
SIGMA = 5.670374419e-8  # W/(m²·K⁴)
DRIFT_ORIGIN = 293.15  # K: drifts are counted from 20 °C


@njit
def root(dp):
    """sign(Δp)·√|Δp|, smooth below 1 kPa."""
    return dp / (dp * dp + 1e6) ** 0.25


@compiled
def above_20_celsius(t, fade):
    """T − 20 °C, levelling off."""
    warmer = t - DRIFT_ORIGIN
    return warmer / (1.0 + fade * abs(warmer))


@njit
def viscosity(t, p, b):
    """Vogel's law, times the pressure term if there is one."""
    law = b.vogel_a * math.exp(b.vogel_b / (t - b.vogel_c))
    return law * math.exp(b.barus * p / (1.0 + b.barus_fade * abs(p)))


@njit
def stiffness(p, b):
    """Bulk modulus of oil with free air and hoses; it vanishes where vapour forms."""
    absolute = max(p + ATMOSPHERE, 2e3)
    compliance = 1.0 / b.beta_oil
    if b.air > 0.0:
        free = b.air / (1.0 + b.air_dissolving * max(p, 0.0))
        volume = free * (ATMOSPHERE / absolute) ** (1.0 / b.air_exponent)
        softer = (1.0 - free) * compliance + volume / (b.air_exponent * absolute)
        compliance = softer / (1.0 - free + volume)
    compliance += b.hose / (1.0 + max(p, 0.0) / b.hose_stiffening)
    liquid = 1.0 / (1.0 + math.exp(-(p - VAPOUR) / 5e3))
    return (1e-4 + liquid) / compliance


@njit
def throttled(area, dp, rho, mu, b):
    """Flow through the throttle in series with an edge; blended towards laminar where that is hidden."""
    cd = b.cd
    if b.transition > 0.0:
        speed = math.sqrt(2.0 * abs(dp) / rho + 1e-6)
        reynolds = rho * speed * math.sqrt(4.0 * area / math.pi) / mu
        ratio = (reynolds / b.transition) ** b.transition_power
        cd *= math.sqrt(ratio / (ratio + 2.0))
    return cd * area * math.sqrt(2.0 / rho) * root(dp)


@njit
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


@njit
def leak(size, turbulent, dp, mu, rho):
    """A laminar gap, `size`·Δp/µ, of which a share behaves as an orifice: alike at 30 bar and 40 °C."""
    if size == 0.0:
        return 0.0
    laminar = size * dp / mu
    orifice = size * 3e6 / 0.0289 * root(dp) / math.sqrt(3e6) * math.sqrt(870.0 / rho)
    return (1.0 - turbulent) * laminar + turbulent * orifice


@compiled
def past_piston(dp, mu, b):
    """Through the eccentric gap between piston and bore, which pressure widens."""
    gap = b.piston_gap * (1.0 + b.piston_opening * abs(dp))
    size = math.pi * 0.050 * gap**3 / (12.0 * b.piston_length) * (1.0 + 1.5 * b.piston_eccentricity**2)
    return size * dp / mu


@njit
def end_stop(depth, speed, b):
    """Force of an end stop compressed by `depth` [m] at `speed` [m/s]; contact is smoothed over some µm."""
    reach = math.sqrt(depth * depth + CONTACT * CONTACT)
    spring = b.stop_stiffness * 0.5 * (depth + reach)
    return spring + b.stop_damping * 0.5 * (1.0 + depth / reach) * speed


@njit
def friction(v, z, p_a, p_b, b):
    """LuGre: returns the force and dz/dt. Sliding force, Stribeck excess and seals share one bristle."""
    sliding = b.coulomb + b.seal_friction * (max(p_a, 0.0) + max(p_b, 0.0))
    level = sliding + b.static * math.exp(-((v / b.stribeck_speed) ** 2))
    if level <= 0.0:
        return 0.0, -z
    slip = v - b.bristle * abs(v) * z / level
    return b.bristle * z + 2.0 * math.sqrt(b.bristle) * slip, slip


@njit
def unlisted_force(x, v, p_a, t, b):
    """Forces against extension that are in no library."""
    sign, speed, bump = math.tanh(v / 2e-3), v / 0.1, math.exp(-(((x - 0.06) / 0.015) ** 2))
    force = b.groove * bump + b.scuff * bump * sign + b.tight * bump * speed
    force += b.cushion * max(x - 0.07, 0.0) / 0.05 * speed
    force += b.cold_seal * math.exp(-(t - DRIFT_ORIGIN) / 25.0) * sign
    force += b.half_drag * speed / math.sqrt(abs(speed) + 1e-4) + b.cube_drag * speed**3
    force += b.bent_rod * x / 0.12 * sign + b.rubber * math.exp((x - 0.12) / 0.03)
    force += b.grip * sign * math.exp(-((v / 0.03) ** 2))
    return force + b.diaphragm * (p_a / 3e6) ** 2


@njit
def unlisted_flows(x, p_a, p_b, ps, t, b):
    """Leaks that are in no library: past the piston, from the cap side, the rod side and the pump."""
    across = (p_a - p_b) / 3e6
    past = b.score * math.exp(-(((x - 0.06) / 0.015) ** 2)) * across + b.lip_ab * across * abs(across)
    from_a = b.nozzle_a * root(p_a) / math.sqrt(3e6) + b.lip_a * (p_a / 3e6) * abs(p_a / 3e6)
    from_a += b.crack_a * max(p_a - 0.5e6, 0.0) / 3e6
    from_b = b.nozzle_b * root(p_b) / math.sqrt(3e6)
    from_p = b.lip_p * (ps / 3e6) * abs(ps / 3e6) + b.warm_slip * (ps / 3e6) * (t - DRIFT_ORIGIN) / 20.0
    return past, from_a, from_b, from_p


@compiled
def rhs(y, inputs, b, f):  # noqa: PLR0915 - one bench, one right-hand side, read from top to bottom
    """Write dy/dt into `f`."""
    command, setting, heat, ambient = inputs[0], inputs[1], inputs[2], inputs[3]
    ps, p_a, p_b, x, v, u = y[PS], y[PA], y[PB], y[X], y[V], y[SPOOL]
    t = y[T_LINE] if b.line_share != 0.0 else y[T_OIL]
    rho = b.rho15 * (1.0 - b.expansion * (t - 288.15))
    mu = viscosity(t, 0.5 * (p_a + p_b), b)

    edge = b.edge_area * abs(u)
    warmer = above_20_celsius(t, b.drift_fade)
    throttle = b.throttle_area * (1.0 + b.throttle_drift * warmer)
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

    q_ab = past_piston(p_a - p_b, mu, b)
    land, seal = b.spool_leak_turbulent, b.seal_leak_turbulent
    leak_pa, leak_pb = (
        leak(b.spool_leak, land, ps - p_a, mu, rho),
        leak(b.spool_leak, land, ps - p_b, mu, rho),
    )
    leak_at, leak_bt = leak(b.spool_leak, land, p_a, mu, rho), leak(b.spool_leak, land, p_b, mu, rho)
    into_a = q_pa - q_at - b.area_a * v - q_ab + leak_pa - leak_at - leak(b.cap_leak, seal, p_a, mu, rho)
    past, from_a, from_b, from_p = unlisted_flows(x, p_a, p_b, ps, t, b)
    into_a -= past + from_a
    into_b = (
        past
        - from_b
        + q_pb
        - q_bt
        + b.area_b * v
        + q_ab
        + leak_pb
        - leak_bt
        - leak(b.rod_leak, seal, p_b, mu, rho)
    )

    wanted = setting * (1.0 + b.relief_drift * warmer)
    full = b.pump_flow
    resistance = b.relief_r + b.relief_extra_r / (1.0 + abs(ps - wanted) / b.relief_soft)
    relief = max(0.0, full + (ps - wanted) / resistance)
    slip = leak(b.pump_slip, b.slip_turbulent, ps, mu, rho)
    out_of_p = q_pa + q_pb + leak_pa + leak_pb + relief + slip + from_p

    f[PA] = stiffness(p_a, b) / (b.dead_a + b.area_a * x) * into_a
    f[PB] = stiffness(p_b, b) / (b.dead_b + b.area_b * (b.stroke - x)) * into_b
    f[PS] = stiffness(ps, b) / b.line_volume * (full - out_of_p)

    rub, f[BRISTLE] = friction(v, y[BRISTLE], p_a, p_b, b)
    stops = end_stop(-x, -v, b) - end_stop(x - b.stroke, v, b)
    film = b.film * mu * v / (1.0 + b.film_thinning * abs(v))
    force = b.area_a * p_a - b.area_b * p_b - b.damping * v - film - rub + stops
    force -= unlisted_force(x, v, p_a, t, b)
    force -= b.constant_load + b.spring * x * (1.0 + b.spring_progress * x)
    f[X] = v
    f[V] = force / (b.mass + b.load_mass)

    if b.spool_second > 0.0:
        f[PILOT] = (command - y[PILOT]) / b.spool_second
        f[SPOOL] = (y[PILOT] - u) / b.spool_time
    else:
        f[PILOT] = command - y[PILOT]
        f[SPOOL] = (command - u) / b.spool_time

    capacity = rho * b.tank_volume * b.cp + b.wall_capacity
    gain = heat + b.pump_heat * ps * full / b.efficiency
    gain -= (b.area_a * p_a - b.area_b * p_b) * v
    gain -= b.loss * (y[T_OIL] - ambient) + b.radiation * SIGMA * (y[T_OIL] ** 4 - ambient**4)
    f[T_OIL] = gain / capacity
    f[T_LINE] = f[T_OIL]
    if b.line_share != 0.0:
        f[T_LINE] += (max(q_pa, 0.0) + max(q_pb, 0.0)) / b.line_mixing * (y[T_OIL] - y[T_LINE])
    f[T_PROBE] = (y[T_OIL] - y[T_PROBE]) / b.thermocouple_time if b.thermocouple_time > 0.0 else f[T_OIL]
    late = b.pressure_time * (1.0 + b.pressure_time_viscous * (mu / 0.0289 - 1.0))
    f[P_PROBE] = (ps - y[P_PROBE]) / late if late > 0.0 else f[PS]
