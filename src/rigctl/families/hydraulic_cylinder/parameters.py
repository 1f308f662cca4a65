"""The cylinder's parameters: names, units, values of the published bench, bounds."""

from __future__ import annotations

from dataclasses import replace

from rigctl.physics.family import ParameterDeclaration as Parameter
from rigctl.physics.oil import HL32

_MM2 = 1e-6
_CM3 = 1e-6

#: dimensions and properties that no fit changes: numbers in the compiled equations
FIXED = (
    Parameter("bore", "mm", 50e-3, "cylinder bore", fixed=True),
    Parameter("rod", "mm", 25e-3, "rod diameter", fixed=True),
    Parameter("stroke", "mm", 250e-3, "stroke", fixed=True),
    Parameter("tank_fill", "l", 80e-3, "oil in the tank: the fill, not the tank's size", fixed=True),
    Parameter("specific_heat", "J/(kg*K)", HL32.heat_capacity, "of the oil", fixed=True),
    Parameter("density_15", "kg/m^3", HL32.density_15, "oil density at 15 degC", fixed=True),
    Parameter("vogel_a", "Pa*s", HL32.vogel.a, "a of Vogel's law", fixed=True),
    Parameter("vogel_b", "K", HL32.vogel.b, "b of Vogel's law", fixed=True),
    Parameter("vogel_c", "K", HL32.vogel.c, "c of Vogel's law", fixed=True),
    Parameter("end_stop_stiffness", "N/m", 2e8, "of each end stop", fixed=True),
    Parameter("end_stop_damping", "N*s/m", 1e5, "of each end stop", fixed=True),
)

FITTABLE = (
    Parameter("flow_area", "mm^2", 3.3 * _MM2, "opening A_t of the flow-control valve", 0.1 * _MM2, 1e-4),
    Parameter("edge_area", "mm^2", 28.0 * _MM2, "one edge A_e of the directional valve", 1e-6, 1e-3),
    Parameter("discharge_coefficient", "1", 0.62, "Cd of every restriction", 0.3, 1.0),
    Parameter("dead_volume_a", "cm^3", 60.0 * _CM3, "oil of the cap side at x = 0", 5e-6, 2e-3),
    Parameter("dead_volume_b", "cm^3", 60.0 * _CM3, "oil of the rod side at full stroke", 5e-6, 2e-3),
    Parameter("line_volume", "cm^3", 400.0 * _CM3, "oil between pump and valve", 2e-5, 1e-2),
    Parameter("bulk_modulus", "MPa", HL32.bulk_modulus, "beta of the oil without air", 1e8, 3e9),
    Parameter("thermal_expansion", "1/K", HL32.thermal_expansion, "alpha_v of the oil", 0.0, 2e-3),
    Parameter("moving_mass", "kg", 12.0, "piston, rod and load", 0.5, 1e3),
    Parameter("viscous_damping", "N*s/m", 120.0, "friction per speed", 0.0, 2e4),
    Parameter("load_force", "N", 0.0, "constant load against extension", -2e4, 2e4),
    Parameter("spool_time", "ms", 25e-3, "time constant of the spool", 1e-3, 0.5),
    Parameter("pump_flow", "l/min", 14e-3 / 60.0, "delivery of the pump", 1e-6, 1e-2),
    Parameter("relief_resistance", "Pa*s/m^3", 2e8, "R: pressure per relief flow", 1e7, 1e11),
    Parameter("hydromechanical_efficiency", "1", 0.9, "of the pump", 0.3, 1.0),
    Parameter("tank_conductance", "W/K", 12.0, "UA: heat lost per kelvin above ambient", 0.0, 500.0),
    Parameter("pump_heat_share", "1", 1.0, "share of the pump's power that heats the tank", 0.0, 1.2),
)

#: which bounds are only usual, where some are physical: a share above one
_USUAL = {
    "discharge_coefficient": (True, False),
    "hydromechanical_efficiency": (True, False),
    "pump_heat_share": (False, False),
}

PARAMETERS = (
    *FIXED,
    *(replace(one, usual=_USUAL.get(one.name, (one.low != 0.0, True))) for one in FITTABLE),
)

#: names in a rig file that differ from those of the parameters
RIG_NAMES = {"throttle_area": ("flow_area",)}
