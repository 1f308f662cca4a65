"""The heat balance of the tank.

``rho * V * cp * dT/dt = P_heater + ps * Q_pump / eta - W_mech - UA * (T - T_amb) + effects``: all power
of the pump becomes heat except for the work on the load.
"""

from __future__ import annotations

from rigctl.engine.symbols import Scalar
from rigctl.physics import oil
from rigctl.physics.scope import Scope


def heat_capacity(m: Scope) -> Scalar:
    """Heat capacity of the oil in the tank: ``rho(T) * V * cp``."""
    return oil.density(m.oil_temperature, m.density_15, m.thermal_expansion) * m.tank_fill * m.specific_heat


def pump_heat(m: Scope) -> Scalar:
    """``s * ps * Q_pump / eta_hm``, also in neutral, when all of it is dissipated over the relief valve.

    s is the share that heats the tank, by default 1; Q_pump is 0 while the pump is off.
    """
    power = m.supply_pressure * m.pump_flow * m.pump / m.hydromechanical_efficiency
    return m.pump_heat_share * power


def ambient_loss(m: Scope) -> Scalar:
    """``UA * (T - T_amb)``."""
    return m.tank_conductance * (m.oil_temperature - m.ambient_temperature)


def work_on_load(m: Scope) -> Scalar:
    """``F_load * v``; the work of friction remains in the oil as heat."""
    return m.load * m.velocity


def oil_temperature_rate(m: Scope) -> Scalar:
    """The sum of the heat flows divided by the heat capacity of the oil, in K/s."""
    gain = m.heater_power + m.total("heater_power") + m.pump_heat
    loss = m.work_on_load + m.ambient_loss
    return (gain - loss + m.total("heat")) / m.heat_capacity
