"""The two chambers: the flows into and out of them, and the rates of their pressures.

``dp/dt = beta / V * (flow in - dV/dt)`` (Merritt, section 6-1). Extending opens P-A and B-T, retracting P-B
and A-T; in neutral all four ports are blocked.
"""

from __future__ import annotations

import math

from rigctl.engine.symbols import Scalar
from rigctl.families.hydraulic_cylinder.fluid import bulk_modulus_at
from rigctl.families.hydraulic_cylinder.restrictions import path_flow
from rigctl.physics.scope import Scope


def area_a(m: Scope) -> Scalar:
    """Piston area on the cap side: ``pi/4 * D^2``."""
    return math.pi / 4.0 * m.bore**2


def area_b(m: Scope) -> Scalar:
    """Annular area on the rod side: ``pi/4 * (D^2 - d^2)``."""
    return math.pi / 4.0 * (m.bore**2 - m.rod**2)


def volume_a(m: Scope) -> Scalar:
    """Volume of the cap-side chamber: ``V0A + A_A * x``."""
    return m.dead_volume_a + m.area_a * m.position


def volume_b(m: Scope) -> Scalar:
    """Volume of the rod-side chamber: ``V0B + A_B * (L - x)``."""
    return m.dead_volume_b + m.area_b * (m.stroke - m.position)


def _flow(m: Scope, opening: Scalar, pressure_drop: Scalar, throttled_by: str) -> Scalar:
    throttled = m.option("throttle") in (throttled_by, "both")
    return path_flow(m, opening, pressure_drop, throttled=throttled)


def flow_supply_to_a(m: Scope) -> Scalar:
    """Through the edge P-A, open while extending."""
    return _flow(m, m.opening_extend, m.supply_pressure - m.pressure_a, "meter_in")


def flow_b_to_return(m: Scope) -> Scalar:
    """Through the edge B-T, open while extending; the tank is at 0 gauge."""
    return _flow(m, m.opening_extend, m.pressure_b, "meter_out")


def flow_supply_to_b(m: Scope) -> Scalar:
    """Through the edge P-B, open while retracting."""
    return _flow(m, m.opening_retract, m.supply_pressure - m.pressure_b, "meter_in")


def flow_a_to_return(m: Scope) -> Scalar:
    """Through the edge A-T, open while retracting."""
    return _flow(m, m.opening_retract, m.pressure_a, "meter_out")


def leak_a(m: Scope) -> Scalar:
    """Sum of the effects' flows into chamber A."""
    return m.total("flow_p_to_a") - m.total("flow_a_to_tank") - m.total("flow_a_to_b")


def leak_b(m: Scope) -> Scalar:
    """Sum of the effects' flows into chamber B."""
    outwards = m.total("flow_b_to_tank") + m.total("flow_b_to_outside")
    return m.total("flow_p_to_b") - outwards + m.total("flow_a_to_b")


def pressure_a_rate(m: Scope) -> Scalar:
    """``dp_A/dt = beta / V_A * (Q_A - A_A * v + leak_a)``, Q_A being the flow through the valve into A."""
    through_valve = m.flow_supply_to_a - m.flow_a_to_return
    balance = through_valve - m.area_a * m.velocity + m.leak_a
    return bulk_modulus_at(m, m.pressure_a) / m.volume_a * balance


def pressure_b_rate(m: Scope) -> Scalar:
    """``dp_B/dt = beta / V_B * (A_B * v - Q_B + leak_b)``, Q_B being the flow through the valve out of B."""
    through_valve = m.flow_b_to_return - m.flow_supply_to_b
    balance = m.area_b * m.velocity - through_valve + m.leak_b
    return bulk_modulus_at(m, m.pressure_b) / m.volume_b * balance
