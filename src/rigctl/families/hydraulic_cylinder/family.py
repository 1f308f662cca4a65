"""The cylinder's declaration: its variables and their equations."""

from __future__ import annotations

from rigctl.families.hydraulic_cylinder import chambers, fluid, piston, restrictions, supply, tank
from rigctl.families.hydraulic_cylinder.parameters import PARAMETERS, RIG_NAMES
from rigctl.families.hydraulic_cylinder.slots import SLOTS
from rigctl.physics.family import (
    Definition,
    Formula,
    InputVariable,
    ModelFamily,
    OutputVariable,
    StateVariable,
)
from rigctl.physics.standard_record import StandardRecord, grid

_FLOW = "m^3/s"

STATES = (
    StateVariable("oil_temperature", "K", 0.1, tank.oil_temperature_rate, 293.15, "oil in the tank"),
    StateVariable("spool", "1", 1e-2, piston.spool_rate, 0.0, "valve spool, -1 retract to 1 extend"),
    StateVariable("supply_pressure", "Pa", 1e4, supply.supply_pressure_rate, 20e5, "before the valve"),
    StateVariable("pressure_a", "Pa", 1e4, chambers.pressure_a_rate, 0.0, "cap side"),
    StateVariable("pressure_b", "Pa", 1e4, chambers.pressure_b_rate, 0.0, "rod side"),
    StateVariable("position", "m", 1e-3, piston.position_rate, 0.0, "of the piston, 0 retracted"),
    StateVariable("velocity", "m/s", 1e-2, piston.velocity_rate, 0.0, "of the piston, positive extending"),
)

INPUTS = (
    InputVariable(
        "valve", "1", 0.0, "-1 retract, 0 neutral, 1 extend", delay=piston.valve_delay, role="move"
    ),
    InputVariable("heater_power", "W", 0.0, "electrical power of the heaters", role="heat"),
    InputVariable(
        "pressure_setpoint", "Pa", 20e5, "setting of the relief valve at full flow", role="set_pressure"
    ),
    InputVariable("ambient_temperature", "K", 295.15, "around the tank"),
    InputVariable("pump", "1", 1.0, "1 runs, 0 stands", implied=True),
)

DEFINITIONS = (
    Definition("line_temperature", "K", fluid.line_temperature, "oil in lines and cylinder"),
    Definition("density", "kg/m^3", fluid.density, "oil in lines and cylinder"),
    Definition("viscosity", "Pa*s", fluid.viscosity, "oil in the cylinder"),
    Definition("area_a", "m^2", chambers.area_a, "piston, cap side"),
    Definition("area_b", "m^2", chambers.area_b, "piston, rod side"),
    Definition("volume_a", "m^3", chambers.volume_a, "oil of the cap side"),
    Definition("volume_b", "m^3", chambers.volume_b, "oil of the rod side"),
    Definition("opening_extend", "1", restrictions.opening_extend, "of the edges P-A and B-T"),
    Definition("opening_retract", "1", restrictions.opening_retract, "of the edges P-B and A-T"),
    Definition("flow_supply_to_a", _FLOW, chambers.flow_supply_to_a, "through the edge P-A"),
    Definition("flow_b_to_return", _FLOW, chambers.flow_b_to_return, "through the edge B-T"),
    Definition("flow_supply_to_b", _FLOW, chambers.flow_supply_to_b, "through the edge P-B"),
    Definition("flow_a_to_return", _FLOW, chambers.flow_a_to_return, "through the edge A-T"),
    Definition("leak_a", _FLOW, chambers.leak_a, "into the cap side, by effects"),
    Definition("leak_b", _FLOW, chambers.leak_b, "into the rod side, by effects"),
    Definition("flow_from_pump", _FLOW, supply.flow_from_pump, "past the check valve"),
    Definition("flow_relief", _FLOW, supply.flow_relief, "over the relief valve"),
    Definition("relief_setting", "Pa", supply.relief_setting, "at full relief flow"),
    Definition("relief_resistance_total", "Pa*s/m^3", supply.relief_resistance_total, "of the relief valve"),
    Definition("friction", "N", piston.friction, "against the motion"),
    Definition("load", "N", piston.load, "against extension"),
    Definition("end_stops", "N", piston.end_stops, "push of the end stops"),
    Definition("heat_capacity", "J/K", tank.heat_capacity, "oil in the tank"),
    Definition("pump_heat", "W", tank.pump_heat, "from the pump into the tank"),
    Definition("ambient_loss", "W", tank.ambient_loss, "from the tank to the room"),
    Definition("work_on_load", "W", tank.work_on_load, "leaving through the rod"),
)


def _reading(state: str) -> Formula:
    """A sensor's reading: the state plus the terms of effects."""
    return lambda m: m[state] + m.total(f"{state}_reading")


OUTPUTS = (
    OutputVariable("oil_temperature", "K", _reading("oil_temperature"), "thermocouple in the tank"),
    OutputVariable("supply_pressure", "Pa", _reading("supply_pressure"), "transducer before the valve"),
    OutputVariable("position", "m", _reading("position"), "position sensor on the rod"),
    OutputVariable("pressure_a", "Pa", _reading("pressure_a"), "transducer at the cap side"),
    OutputVariable("pressure_b", "Pa", _reading("pressure_b"), "transducer at the rod side"),
)

#: hot oil and the highest supply pressure of the published campaign, so that leakage, drift and the limit of
#: the pump's flow are visible
STANDARD_RECORD = StandardRecord(
    "wait 0.2 s, extend 1.05 s, hold closed 1 s, retract 1.5 s; oil at 60 degC, supply at 50 bar, heaters on",
    times=grid(3.75, 0.01),
    switches=(
        (
            0.0,
            {"valve": 0.0, "heater_power": 2000.0, "pressure_setpoint": 50e5, "ambient_temperature": 295.15},
        ),
        (0.2, {"valve": 1.0}),
        (1.25, {"valve": 0.0}),
        (2.25, {"valve": -1.0}),
    ),
    initial={"oil_temperature": 333.15, "supply_pressure": 50e5, "pressure_b": 45e5},
)

FAMILY = ModelFamily(
    name="hydraulic_cylinder",
    title="Valve-controlled double-acting cylinder with one rod, and its heated tank",
    source="Merritt, Hydraulic Control Systems (1967); Jelali & Kroll, Hydraulic Servo-systems (2003)",
    states=STATES,
    inputs=INPUTS,
    parameters=PARAMETERS,
    definitions=DEFINITIONS,
    slots=SLOTS,
    outputs=OUTPUTS,
    options={"throttle": ("meter_in", "meter_out", "both")},
    rig_names=RIG_NAMES,
    standard_record=STANDARD_RECORD,
    single_values={"stroke": ("position", 2.2)},
    generic=False,
)
