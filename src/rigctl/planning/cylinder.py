"""How fast the rod moves: orifice flow over piston area, as far as a plan needs to know it."""

from __future__ import annotations

import math
from dataclasses import dataclass

from rigctl.rig import Rig

#: kg/m³, a mineral oil at 40 °C; the speed goes with its root
_DENSITY = 855.0


@dataclass(frozen=True, slots=True)
class Cylinder:
    """Areas and restrictions of the cylinder; SI."""

    cap_area: float
    rod_area: float
    stroke: float
    restriction: float  #: Cd·A of throttle and valve edge in series
    pump_flow: float

    def speed(self, direction: int, pressure: float) -> float:
        """Metres per second at a supply pressure (Pa, gauge), without load and friction.

        ``v = min(Q_pump, Cd·A·sqrt(2·p_s/rho)) / A_piston``
        """
        flow = min(self.restriction * math.sqrt(2.0 * max(pressure, 0.0) / _DENSITY), self.pump_flow)
        return flow / (self.cap_area if direction > 0 else self.rod_area)


def cylinder_of(rig: Rig) -> Cylinder | None:
    """The cylinder that a rig file describes; None when one of its dimensions is missing."""
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
