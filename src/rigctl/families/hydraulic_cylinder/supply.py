"""Pump, check valve, relief valve and the line between them and the directional valve."""

from __future__ import annotations

from rigctl.engine.symbols import Scalar, positive_part
from rigctl.families.hydraulic_cylinder.fluid import bulk_modulus_at
from rigctl.physics.scope import Scope

#: flow over which the relief valve's opening is rounded, in m^3/s (0.4 % of the pump's)
RELIEF_WIDTH = 1e-6
#: rounding of the check valve's characteristic
CHECK_WIDTH = 1e-8


def flow_from_pump(m: Scope) -> Scalar:
    """Flow through the check valve: the pump's delivery less its slip, never negative."""
    return positive_part(m.pump_flow * m.pump - m.total("flow_p_to_tank"), CHECK_WIDTH)


def relief_resistance_total(m: Scope) -> Scalar:
    """R: the increase of the pressure per flow over the relief valve, in Pa*s/m^3."""
    return m.relief_resistance + m.total("relief_resistance")


def relief_setting(m: Scope) -> Scalar:
    """The pressure at full relief flow: the set value times the factors of effects."""
    return m.pressure_setpoint * m.factor("relief_setting")


def flow_relief(m: Scope) -> Scalar:
    """``max(0, Q_pump + (ps - p_set) / R)``: at the setting, the full flow of the pump."""
    over = (m.supply_pressure - m.relief_setting) / m.relief_resistance_total
    return positive_part(m.pump_flow + over, RELIEF_WIDTH)


def supply_pressure_rate(m: Scope) -> Scalar:
    """``dp_s/dt = beta / V_line * (Q_pump - Q_to_valve - Q_relief - leaks)``."""
    to_valve = m.flow_supply_to_a + m.flow_supply_to_b
    leaks = m.total("flow_p_to_a") + m.total("flow_p_to_b")
    balance = m.flow_from_pump - to_valve - m.flow_relief - leaks
    return bulk_modulus_at(m, m.supply_pressure) / m.line_volume * balance
