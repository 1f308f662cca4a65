"""The slots of the cylinder's equations, at which effects can act."""

from __future__ import annotations

from rigctl.physics.family import Slot

_FLOW = "m^3/s"
_AT_PRESSURE = (("pressure", "Pa"),)

SLOTS = (
    Slot("flow_a_to_b", _FLOW, "past the piston, from cap side to rod side"),
    Slot("flow_a_to_tank", _FLOW, "from the cap side to tank"),
    Slot("flow_b_to_tank", _FLOW, "from the rod side to tank"),
    Slot("flow_b_to_outside", _FLOW, "from the rod side out along the rod"),
    Slot("flow_p_to_a", _FLOW, "from the supply into the cap side"),
    Slot("flow_p_to_b", _FLOW, "from the supply into the rod side"),
    Slot("flow_p_to_tank", _FLOW, "from the pump's outlet back to tank, before the check valve"),
    Slot("relief_resistance", "Pa*s/m^3", "rise of the relief pressure with its flow"),
    Slot("relief_setting", "1", "of the pressure that was set", combine="product"),
    Slot(
        "throttle_area",
        "1",
        "of the flow-control valve's area",
        combine="product",
        local=(("reynolds", "1"),),
    ),
    Slot("line_resistance", "Pa*s/m^3", "laminar resistance of each cylinder line"),
    Slot("line_turbulence", "Pa*s^2/m^6", "turbulent resistance of each cylinder line"),
    Slot(
        "viscosity",
        "1",
        "of Vogel's viscosity, at the place's pressure",
        combine="product",
        local=_AT_PRESSURE,
    ),
    Slot("compliance", "1/Pa", "of a volume of oil, at its pressure", local=_AT_PRESSURE),
    Slot("friction", "N", "of the piston and rod, against the motion"),
    Slot("load", "N", "of what the rod pushes, against extension"),
    Slot("mass", "kg", "moved with the rod"),
    Slot("heat", "W", "into the tank's oil"),
    Slot("heater_power", "W", "of the heaters, besides what is commanded"),
    Slot("line_temperature", "K", "of lines and cylinder, above the tank's"),
    Slot(
        "valve_delay",
        "s",
        "from the valve's command to its switch",
        kind="command",
        local=(("before", "1"), ("after", "1")),
    ),
    Slot("position_reading", "m", "of the position sensor, beside the truth", kind="sensor"),
    Slot("supply_pressure_reading", "Pa", "of the supply's transducer, beside the truth", kind="sensor"),
    Slot("pressure_a_reading", "Pa", "of the cap side's transducer, beside the truth", kind="sensor"),
    Slot("pressure_b_reading", "Pa", "of the rod side's transducer, beside the truth", kind="sensor"),
    Slot("oil_temperature_reading", "K", "of the thermocouple, beside the truth", kind="sensor"),
)
