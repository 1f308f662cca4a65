"""The dimensions and constants that the shipped model families read from a rig file.

A name that a family does not use is most likely misspelt; it is refused, and the message gives the nearest
valid one. For a rig without a model any name is accepted.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Constant:
    """A dimension or constant: a unit of its dimension, and its meaning."""

    unit: str
    meaning: str


#: lengths, areas and volumes
GEOMETRY: Mapping[str, Mapping[str, Constant]] = {
    "hydraulic_cylinder": {
        "bore": Constant("m", "cylinder bore"),
        "rod": Constant("m", "rod diameter"),
        "stroke": Constant("m", "stroke"),
        "throttle_area": Constant("m^2", "opening of the flow-control valve (A_t)"),
        "edge_area": Constant("m^2", "opening of one edge of the directional valve, fully open (A_e)"),
        "dead_volume_a": Constant("m^3", "oil between valve and piston, cap side, piston at the cap"),
        "dead_volume_b": Constant("m^3", "oil between valve and piston, rod side, piston at the head"),
        "line_volume": Constant("m^3", "oil between pump and directional valve"),
        "tank_fill": Constant("m^3", "oil in the tank: the fill, not the tank's size"),
    },
    "heater_board": {},
    "oil_viscosity": {},
}

#: everything else
CONSTANTS: Mapping[str, Mapping[str, Constant]] = {
    "hydraulic_cylinder": {
        "discharge_coefficient": Constant("1", "of every restriction (Cd)"),
        "moving_mass": Constant("kg", "piston, rod and load"),
        "viscous_damping": Constant("N*s/m", "friction per speed"),
        "spool_time": Constant("s", "time constant of the spool"),
        "relief_resistance": Constant("Pa*s/m^3", "rise of the relief pressure per flow (R)"),
        "pump_flow": Constant("m^3/s", "delivery of the pump"),
        "hydromechanical_efficiency": Constant("1", "of the pump"),
        "end_stop_stiffness": Constant("N/m", "of each end stop"),
        "end_stop_damping": Constant("N*s/m", "of each end stop"),
        "tank_conductance": Constant("W/K", "heat loss of the tank per kelvin above ambient (UA)"),
        "ambient_temperature": Constant("K", "around the tank"),
        "load_force": Constant("N", "constant external load, against extension"),
        "pump_heat_share": Constant("1", "share of the pump's power that heats the tank"),
        "bulk_modulus": Constant("Pa", "of the oil without air"),
        "thermal_expansion": Constant("1/K", "of the oil (alpha_v)"),
        "specific_heat": Constant("J/(kg*K)", "of the oil"),
        "density_15": Constant("kg/m^3", "of the oil at 15 degC"),
        "vogel_a": Constant("Pa*s", "a of Vogel's law of viscosity"),
        "vogel_b": Constant("K", "b of Vogel's law of viscosity"),
        "vogel_c": Constant("K", "c of Vogel's law of viscosity"),
    },
    "heater_board": {
        "heater_gain": Constant("W", "power of either heater at 100 %"),
        "heater_gain_1": Constant("W", "power of the first heater at 100 %"),
        "heater_gain_2": Constant("W", "power of the second heater at 100 %"),
        "heat_capacity": Constant("J/K", "of one heater with its sensor"),
        "convection": Constant("W/K", "heat loss of one heater per kelvin above ambient"),
        "ambient_temperature": Constant("K", "around the board"),
    },
    "oil_viscosity": {},
}
