"""The effects that the separate bench can hide: the cylinder's library, in different shapes."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from rigctl.errors import unknown_name
from rigctl_validation.bench.parameters import BenchParameters
from rigctl_validation.hidden_effect import HiddenEffect, Shape

#: a viscosity law that agrees at 40 degC and is 12 % too thick at 80 degC
_WRONG_OIL = {"vogel_a": 1.5064e-4, "vogel_b": 700.0, "vogel_c": 180.0}
_SOFT_BRISTLE = {"bristle": 2e5, "stribeck_speed": 0.05}
_TOO_SHORT = "a record lasts 3.75 s and the heaters stay off: "
_NO_VISCOSITY = "alone it changes nothing: no term of the base model contains the viscosity"


def find_hidden(effect: str) -> HiddenEffect:
    """The counterpart of the library's `effect` in the separate bench.

    Raises
    ------
    RigctlError
        the library of the cylinder has no such effect.
    """
    known = {hidden.effect: hidden for hidden in HIDDEN_EFFECTS}
    if effect not in known:
        raise unknown_name("effect of the cylinder", effect, known)
    return known[effect]


def _one(name: str, factor: float = 1.0) -> Callable[[float], Mapping[str, float]]:
    return lambda amplitude: {name: factor * amplitude}


def _nothing(_amplitude: float) -> Mapping[str, float]:
    return {}


def _piston(conductance: float) -> Mapping[str, float]:
    """The gap of an eccentric piston that leaks `conductance` [m³]."""
    bench = BenchParameters()
    eccentric = 1.0 + 1.5 * bench.piston_eccentricity**2
    cube = 12.0 * bench.piston_length * conductance / (math.pi * 0.050 * eccentric)
    return {"piston_gap": cube ** (1.0 / 3.0)}


def _shares(name: str, other: float, wrong: float) -> Mapping[Shape, Mapping[str, float]]:
    return {"same": {name: 0.0}, "other": {name: other}, "wrong": {name: wrong, **_WRONG_OIL}}


_FADE: Mapping[Shape, Mapping[str, float]] = {
    "same": {"drift_fade": 0.0},
    "other": {},
    "wrong": {"drift_fade": 0.02},
}
_BRISTLES: Mapping[Shape, Mapping[str, float]] = {"same": {}, "other": {}, "wrong": _SOFT_BRISTLE}
_JITTER: Mapping[Shape, Mapping[str, float]] = {
    "same": {},
    "other": {"jitter_share": 0.05},
    "wrong": {"jitter_share": 0.3},
}
_ORIFICE_SHARE = "a share of it behaves as an orifice; wrong: half of it, and another viscosity law"
_LEVELS_OFF = "it levels off as the oil warms; wrong: two thirds of it are reached at half of the way"
_UNSTEADY = "it differs from switch to switch by 5 %; wrong: by 30 %"
_LUGRE = "LuGre friction with a bristle of 2 N/um; wrong: ten times softer, Stribeck velocity 50 mm/s"

HIDDEN_EFFECTS: tuple[HiddenEffect, ...] = (
    # --- leakages: amplitude is the conductance, m³
    HiddenEffect(
        "piston_leakage", "conductance", 5.2e-15, 2e-12, _piston,
        shapes={"same": {}, "other": {"piston_opening": 1e-8},
                "wrong": {"piston_opening": 6e-8, **_WRONG_OIL}},
        differs="pressure widens the eccentric gap, 16 % more flow at 50 bar; wrong: twice, and another oil",
    ),
    HiddenEffect(
        "valve_leakage", "conductance", 4e-15, 1e-12, _one("spool_leak"),
        shapes=_shares("spool_leak_turbulent", 0.15, 0.5), differs=_ORIFICE_SHARE,
    ),
    HiddenEffect(
        "cap_leakage", "conductance", 5e-15, 2e-13, _one("cap_leak"),
        shapes=_shares("seal_leak_turbulent", 0.1, 0.5), differs=_ORIFICE_SHARE,
    ),
    HiddenEffect(
        "rod_leakage", "conductance", 1e-15, 2e-13, _one("rod_leak"),
        shapes=_shares("seal_leak_turbulent", 0.1, 0.5), differs=_ORIFICE_SHARE,
    ),
    HiddenEffect(
        "pump_slip", "conductance", 3.5e-14, 1e-12, _one("pump_slip"),
        shapes=_shares("slip_turbulent", 0.1, 0.5), differs=_ORIFICE_SHARE,
    ),
    # --- supply
    HiddenEffect(
        "relief_override", "resistance", 1e9, 2e10, _one("relief_extra_r"),
        shapes={"same": {"relief_soft": math.inf}, "other": {}, "wrong": {"relief_soft": 5e4}},
        differs="the valve is stiffer away from its setting, half at 2 bar; wrong: half at 0.5 bar",
        depends_also="supply_pressure",
    ),
    HiddenEffect(
        "relief_thermal_drift", "coefficient", 1e-3, 1e-2, _one("relief_drift", -1.0),
        shapes=_FADE, differs=_LEVELS_OFF, signs=(1, -1),
    ),
    # --- orifices and lines
    HiddenEffect(
        "laminar_throttle", "transition_reynolds", 100.0, 2e3, _one("transition"),
        shapes={"same": {"transition_power": 1.0}, "other": {},
                "wrong": {"transition_power": 0.5, **_WRONG_OIL}},
        differs="losses with Re to the power -0.8; wrong: -0.5 as in a short tube, and another viscosity law",
        comparable=False,
    ),
    HiddenEffect(
        "flow_area_thermal_drift", "coefficient", -1e-3, 1e-2, _one("throttle_drift"),
        shapes=_FADE, differs=_LEVELS_OFF, signs=(-1, 1),
    ),
    HiddenEffect(
        "line_loss", "length", 2.0, 50.0, lambda length: {"line_length": length, "line_zeta": 2.5 * length},
        shapes={"same": {"line_bore": 8e-3}, "other": {"line_bore": 8e-3},
                "wrong": {"line_bore": 10e-3, **_WRONG_OIL}},
        differs="turbulent by Blasius where Re says so; wrong: another bore and viscosity law",
        comparable=False,
    ),
    # --- oil
    HiddenEffect(
        "barus", "coefficient", 2e-8, 1e-7, _one("barus"), differs="it fades at high pressure",
        comparable=False, cannot_act=_NO_VISCOSITY,
    ),
    HiddenEffect(
        "modulus_viscosity", "share", 1.0, 5.0, lambda share: {"barus": 2.15e-8 * share},
        differs="the same at every temperature", comparable=False, cannot_act=_NO_VISCOSITY,
    ),
    HiddenEffect(
        "entrained_air", "fraction", 5e-3, 0.1, _one("air"),
        shapes={"same": {"air_exponent": 1.4}, "other": {}, "wrong": {"air_dissolving": 1e-6}},
        differs="compressed more slowly, exponent 1.25; wrong: it dissolves, half of it at 10 bar",
    ),
    HiddenEffect(
        "hose_compliance", "compliance", 3e-10, 1e-8, _one("hose"),
        shapes={"same": {"hose_stiffening": math.inf}, "other": {}, "wrong": {"hose_stiffening": 2e6}},
        differs="the hose stiffens, half at 100 bar; wrong: half at 20 bar",
        depends_also="pressure_a",
    ),
    # --- forces
    HiddenEffect(
        "viscous_friction", "coefficient", 500.0, 2e4, _one("film"),
        shapes={"same": {"film_thinning": 0.0}, "other": {}, "wrong": {"film_thinning": 5.0, **_WRONG_OIL}},
        differs="the film gives way with speed, 10 % at 0.1 m/s; wrong: a third, and another viscosity law",
        absorbed_by=("viscous_damping",),
    ),
    HiddenEffect(
        "coulomb_friction", "force", 100.0, 2e3, _one("coulomb"),
        shapes=_BRISTLES, differs=_LUGRE, comparable=False,
    ),
    HiddenEffect(
        "stribeck_friction", "static_force", 200.0, 4e3,
        lambda force: {"coulomb": 0.4 * force, "static": 0.6 * force},
        shapes=_BRISTLES, differs=_LUGRE, comparable=False,
    ),
    HiddenEffect(
        "pressure_friction", "area", 20e-6, 500e-6, _one("seal_friction"),
        shapes=_BRISTLES, differs=_LUGRE, comparable=False,
    ),
    HiddenEffect(
        "load_mass", "mass", 20.0, 500.0, _one("load_mass"), absorbed_by=("moving_mass",),
    ),
    HiddenEffect(
        "spring_load", "stiffness", 2e3, 2e4, _one("spring"),
        shapes={"same": {"spring_progress": 0.0}, "other": {}, "wrong": {"spring_progress": 10.0}},
        differs="a progressive spring, 10 % stiffer at 100 mm; wrong: twice as stiff",
    ),
    HiddenEffect(
        "constant_load", "force", 200.0, 2e3, _one("constant_load"), signs=(1, -1),
    ),
    # --- the valve's timing: amplitude is the delay, s
    HiddenEffect(
        "valve_open_delay", "delay", 20e-3, 0.18, _one("open_delay"),
        shapes=_JITTER, differs=_UNSTEADY, absorbed_by=("spool_time",),
    ),
    HiddenEffect(
        "valve_close_delay", "delay", 20e-3, 0.3, _one("close_delay"),
        shapes=_JITTER, differs=_UNSTEADY, absorbed_by=("spool_time",),
    ),
    HiddenEffect(
        "valve_delay_thermal", "coefficient", 1e-3, 5e-3, _one("delay_per_kelvin"),
        shapes={"same": {"delay_fade": 0.0}, "other": {}, "wrong": {"delay_fade": 0.02}},
        differs=_LEVELS_OFF,
    ),
    # --- sensors
    HiddenEffect(
        "position_backlash", "width", 0.3e-3, 5e-3, _one("position_backlash"),
        differs="a sharp play", comparable=False,
    ),
    HiddenEffect(
        "position_gain", "error", 0.01, 0.2, _one("position_gain"), signs=(1, -1),
        shapes={"same": {}, "other": {}, "wrong": {"position_bow": 0.5}},
        differs="wrong only: the error grows along the stroke, 5 % at 100 mm", absorbed_by=("flow_area",),
    ),
    HiddenEffect(
        "position_offset", "offset", 1e-3, 50e-3, _one("position_offset"), signs=(1, -1),
        absorbed_by=("the start position of each record",),
    ),
    HiddenEffect(
        "position_thermal_drift", "coefficient", -1e-3, 1e-2, _one("position_drift"), signs=(-1, 1),
        shapes={"same": {"position_drift_fade": 0.0}, "other": {}, "wrong": {"position_drift_fade": 0.02}},
        differs=_LEVELS_OFF,
    ),
    HiddenEffect("pressure_gain", "error", 0.01, 0.2, _one("pressure_gain"), signs=(1, -1)),
    HiddenEffect(
        "pressure_offset", "offset", 0.5e5, 10e5, _one("pressure_offset"), signs=(1, -1),
        shapes={"same": {}, "other": {"pressure_offset_warming": 0.002},
                "wrong": {"pressure_offset_warming": 0.02}},
        differs="it grows as the bench warms, 12 % to 80 degC; wrong: to more than twice",
        depends_also="oil_temperature",
    ),
    HiddenEffect(
        "pressure_lag", "lag", 20e-3, 2.0, _one("pressure_time"),
        shapes={"same": {}, "other": {"pressure_time_viscous": 0.3}, "wrong": {"pressure_time_viscous": 0.9}},
        differs="30 % of it goes with the viscosity, as in a damping nozzle; wrong: 90 %",
        depends_also="oil_temperature",
    ),
    HiddenEffect(
        "thermocouple_lag", "lag", 10.0, 300.0, _one("thermocouple_time"),
        cannot_act=_TOO_SHORT + "the pump warms the oil by 0.03 K, a third of the thermometer's noise",
    ),
    HiddenEffect(
        "thermocouple_offset", "offset", 1.0, 20.0, _one("thermocouple_offset"), signs=(1, -1),
        absorbed_by=("the start temperature of each record", "flow_area"),
    ),
    # --- heat
    HiddenEffect(
        "radiation_loss", "area", 1.0, 20.0, _one("radiation"),
        cannot_act=_TOO_SHORT + "hot oil cools by 0.01 K per square metre",
    ),
    HiddenEffect(
        "heater_lag", "lag", 20.0, 600.0, _nothing, comparable=False,
        cannot_act=_TOO_SHORT + "there is no switching of heaters to be late",
    ),
    HiddenEffect(
        "wall_heat_capacity", "capacity", 2e4, 5e5, _one("wall_capacity"), comparable=False,
        cannot_act=_TOO_SHORT + "the oil warms by 0.03 K, of which the wall takes a part",
    ),
    HiddenEffect(
        "line_oil_temperature", "share", 0.2, 0.95, _one("line_share"),
        shapes={"same": {"line_mixing": math.inf}, "other": {}, "wrong": {"line_mixing": 1e-3}},
        differs="fresh oil mixes with it, 10 % in a stroke; wrong: 20 %",
    ),
    # --- base physics: amplitude is the share that is missing
    HiddenEffect(
        "density_expansion", "thermal_expansion", 1.0, 1.0, _one("expansion", -7e-4), comparable=False,
        base=True,
    ),
    HiddenEffect(
        "linear_friction", "viscous_damping", 1.0, 1.0, _one("damping", -120.0), comparable=False, base=True,
        absorbed_by=("viscous_damping",),
    ),
    HiddenEffect(
        "spool_lag", "spool_time", 1.0, 1.0, lambda share: {"spool_time": -24e-3 * share}, comparable=False,
        base=True, absorbed_by=("spool_time",),
    ),
    HiddenEffect(
        "ambient_loss", "tank_conductance", 1.0, 1.0, _one("loss", -12.0), comparable=False, base=True,
        cannot_act=_TOO_SHORT + "hot oil loses 0.02 K",
    ),
    HiddenEffect(
        "pump_heating", "pump_heat_share", 1.0, 1.0, _one("pump_heat", -1.0), comparable=False, base=True,
        cannot_act=_TOO_SHORT + "the pump warms the oil by 0.03 K",
    ),
)  # fmt: skip
