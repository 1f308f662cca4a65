"""Forecast of the oil's temperature and of the rod's speed, for the preview of a plan.

The heat balance of the tank is solved in closed form:
``rho·V·cp·dT/dt = P_heater + p_s·Q_pump/η_hm − UA·(T − T_amb)`` is linear while heater power and pressure are
constant, so that the temperature approaches ``T_amb + P/UA`` exponentially, with ``τ = rho·V·cp/UA``. The
density is that at the mean temperature; over 60 K the error of the time is then below 0.1 %.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from rigctl.physics.oil import OILS, Oil, find_oil
from rigctl.rig import Rig

#: assumed for a rig without an oil or with an unknown one: a mineral hydraulic oil
DEFAULT_OIL = "HL32"
#: kg/m³, a mineral oil at 40 °C; the speed varies only with the inverse of its square root
_DENSITY = 855.0


@dataclass(frozen=True, slots=True)
class Tank:
    """The oil in the tank and what heats and cools it; SI."""

    fill: float  #: m³
    oil: Oil
    heater: float  #: W while on
    pump_displacement: float  #: m³/s: heat per pressure, s·Q_pump/η_hm
    loss: float  #: W/K
    ambient: float  #: K

    def power(self, pressure: float, heating: bool) -> float:
        """Heat into the oil in W at this supply pressure (Pa, gauge)."""
        return (self.heater if heating else 0.0) + self.pump_displacement * pressure

    def limit(self, pressure: float, heating: bool) -> float:
        """The temperature (K) that the oil approaches; infinite if it is heated without any loss."""
        power = self.power(pressure, heating)
        if self.loss > 0.0:
            return self.ambient + power / self.loss
        return math.inf if power > 0.0 else self.ambient

    def heat_capacity(self, temperature: float) -> float:
        """Heat capacity of the oil, J/K, at `temperature` in K."""
        return self.oil.density(temperature) * self.fill * self.oil.heat_capacity

    def after(self, temperature: float, seconds: float, pressure: float, heating: bool) -> float:
        """The temperature (K) after `seconds` with constant pressure (Pa, gauge) and heating."""
        # The density, and with it the heat capacity, depends on the temperature that is sought: one step with
        # the capacity at the start, then one with that at the middle.
        rough = self._after(temperature, seconds, pressure, heating, self.heat_capacity(temperature))
        middle = self.heat_capacity(0.5 * (temperature + rough))
        return self._after(temperature, seconds, pressure, heating, middle)

    def _after(
        self, temperature: float, seconds: float, pressure: float, heating: bool, capacity: float
    ) -> float:
        if self.loss <= 0.0:
            return temperature + self.power(pressure, heating) * seconds / capacity
        limit = self.limit(pressure, heating)
        return limit + (temperature - limit) * math.exp(-seconds * self.loss / capacity)

    def time_to(self, target: float, temperature: float, pressure: float, heating: bool) -> float:
        """Seconds until `target` (K) is reached; infinite if it never is."""
        if temperature == target:
            return 0.0
        capacity = self.heat_capacity(0.5 * (temperature + target))
        if self.loss <= 0.0:
            rate = self.power(pressure, heating) / capacity
            return (target - temperature) / rate if rate * (target - temperature) > 0.0 else math.inf
        limit = self.limit(pressure, heating)
        ratio = (limit - temperature) / (limit - target) if limit != target else math.inf
        return capacity / self.loss * math.log(ratio) if 1.0 < ratio < math.inf else math.inf


def tank_of(rig: Rig) -> Tank | None:
    """The tank described by a rig file; None if that has no `tank_fill` or no heater of known power."""

    fill = rig.geometry.get("tank_fill")
    role = rig.roles.heat
    heater = rig.actuators[role.actuator].power if role is not None else None
    if fill is None or heater is None:
        return None
    constants = rig.constants
    oil = find_oil(rig.oil if rig.oil is not None and rig.oil in OILS else DEFAULT_OIL)
    return Tank(
        fill=float(fill),
        oil=oil,
        heater=heater,
        pump_displacement=constants.get("pump_heat_share", 1.0)
        * constants.get("pump_flow", 0.0)
        / constants.get("hydromechanical_efficiency", 1.0),
        loss=constants.get("tank_conductance", 0.0),
        ambient=constants.get("ambient_temperature", rig.simulation.ambient_temperature),
    )


@dataclass(frozen=True, slots=True)
class Cylinder:
    """Areas and restrictions of the cylinder; SI."""

    cap_area: float
    rod_area: float
    stroke: float
    restriction: float  #: Cd·A of throttle and valve edge in series
    pump_flow: float

    def speed(self, direction: int, pressure: float) -> float:
        """Speed in m/s at a supply pressure (Pa, gauge), without load and friction.

        ``v = min(Q_pump, Cd·A·sqrt(2·p_s/rho)) / A_piston``
        """
        flow = min(self.restriction * math.sqrt(2.0 * max(pressure, 0.0) / _DENSITY), self.pump_flow)
        return flow / (self.cap_area if direction > 0 else self.rod_area)


def cylinder_of(rig: Rig) -> Cylinder | None:
    """The cylinder described by a rig file; None if one of its dimensions is missing."""
    names = ("bore", "rod", "stroke", "throttle_area", "edge_area")
    if any(name not in rig.geometry for name in names):
        return None
    bore, rod, stroke, throttle, edge = (float(rig.geometry[name]) for name in names)
    cap_area = math.pi / 4.0 * bore**2
    return Cylinder(
        cap_area=cap_area,
        rod_area=cap_area - math.pi / 4.0 * rod**2,
        stroke=stroke,
        restriction=rig.constants.get("discharge_coefficient", 0.62)
        * throttle
        * edge
        / math.hypot(throttle, edge),
        pump_flow=rig.constants.get("pump_flow", math.inf),
    )
