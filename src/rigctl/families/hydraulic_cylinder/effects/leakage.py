"""Leakage through laminar gaps, ``Q = k * dp / mu``.

Each effect is one gap between two spaces, and its conductance k, a volume, is a property of the gap alone:
the viscosity is the model's, so that one k holds for cold and for hot oil. A gap may be given as a clearance
instead; the fit uses k, in which the flow is linear.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from rigctl.effects.declaration import Effect, EffectParameter, Own, ParameterAlternative, Term
from rigctl.engine.symbols import Scalar
from rigctl.families.hydraulic_cylinder.fluid import viscosity_at
from rigctl.physics.scope import Scope

_FAMILY = "hydraulic_cylinder"
_MERRITT = "Merritt, Hydraulic Control Systems (1967), section 3-2: laminar flow in an annular gap"

#: length of the piston's sealing land, in m, where a gap is given instead of a conductance
LAND = 20e-3


def annular_conductance(diameter: float, clearance: float, length: float) -> float:
    """``k = pi * D * h^3 / (12 * l)`` in m^3: laminar flow per pressure drop, times viscosity.

    Parameters
    ----------
    diameter: D in m.
    clearance: h, the radial gap, in m.
    length: l of the gap in the direction of flow, in m.
    """
    return math.pi * diameter * clearance**3 / (12.0 * length)


def gap_flow(m: Scope, conductance: Scalar, before: Scalar, after: Scalar = 0.0) -> Scalar:
    """``k * (p1 - p2) / mu`` in m^3/s, with the viscosity at the mean pressure; the tank is at 0 gauge."""
    return conductance * (before - after) / viscosity_at(m, 0.5 * (before + after))


def _conductance(start: float, high: float, meaning: str, grid: tuple[float, ...] = ()) -> EffectParameter:
    return EffectParameter(
        "conductance",
        "m^3",
        null=0.0,
        start=start,
        low=0.0,
        high=high,
        meaning=meaning,
        grid=grid,
        physical="low",
    )


def _of_piston(clearance: float, family: Mapping[str, float]) -> float:
    return annular_conductance(family["bore"], clearance, LAND)


def _of_rod(clearance: float, family: Mapping[str, float]) -> float:
    return annular_conductance(family["rod"], clearance, LAND)


def _clearance(of: str, value_of: Callable[[float, Mapping[str, float]], float]) -> ParameterAlternative:
    return ParameterAlternative(
        "clearance",
        "um",
        "conductance",
        value_of,
        f"radial gap h of the {of} over {LAND * 1e3:g} mm: k = pi*D*h^3/(12*l)",
    )


PISTON_LEAKAGE = Effect(
    name="piston_leakage",
    family=_FAMILY,
    summary="Oil passes the piston's seal from the chamber at higher pressure to the other.",
    equation="Q_AB = k·(p_A − p_B)/µ, k = π·D·h³/(12·l)",
    source=_MERRITT,
    terms=(("flow_a_to_b", lambda m, p: gap_flow(m, p.conductance, m.pressure_a, m.pressure_b)),),
    parameters=(_conductance(5.2e-15, 2e-13, "k: a gap of 0 (sealed) to 40 um (worn)"),),
    other_ways=(_clearance("piston", _of_piston),),
    looks_like=(
        "The chamber pressures drift towards one another while the valve is closed, faster in hot oil; the "
        "piston creeps out."
    ),
    confused_with=("rod_leakage", "cap_leakage", "valve_leakage"),
    needs="a hold with the valve closed, or chamber pressures",
)


def _port_flow(chamber: str) -> tuple[tuple[str, Term], ...]:
    side = chamber[-1]

    # In neutral both lands of a port leak: k·(p_S − p) in and k·p out balance at p = p_S/2, whatever k is.
    def from_supply(m: Scope, p: Own) -> Scalar:
        return gap_flow(m, p.conductance, m.supply_pressure, m[chamber])

    def to_tank(m: Scope, p: Own) -> Scalar:
        return gap_flow(m, p.conductance, m[chamber])

    return ((f"flow_p_to_{side}", from_supply), (f"flow_{side}_to_tank", to_tank))


VALVE_LEAKAGE = Effect(
    name="valve_leakage",
    family=_FAMILY,
    summary="Oil passes the spool's clearance at every port, in neutral too.",
    equation="at each port: k·(p_S − p)/µ in, k·p/µ out",
    source=_MERRITT,
    terms=(*_port_flow("pressure_a"), *_port_flow("pressure_b")),
    parameters=(_conductance(4e-15, 1e-12, "k of each land: 2e-16 to 4e-15 m^3 new, to 1e-13 worn"),),
    looks_like=(
        "In neutral both chambers drift to half of the supply pressure, and a single-rod cylinder creeps out."
    ),
    confused_with=("piston_leakage", "position_thermal_drift"),
    needs="a hold with the valve closed, or chamber pressures",
)

CAP_LEAKAGE = Effect(
    name="cap_leakage",
    family=_FAMILY,
    summary="The cap side leaks to tank.",
    equation="Q_AT = k·p_A/µ",
    source=_MERRITT,
    terms=(("flow_a_to_tank", lambda m, p: gap_flow(m, p.conductance, m.pressure_a)),),
    parameters=(_conductance(5e-15, 2e-13, "k of the leak"),),
    looks_like="The cap side loses pressure while the valve is closed; extensions are shorter in hot oil.",
    confused_with=("piston_leakage", "valve_leakage"),
    needs="a hold with the valve closed, or chamber pressures",
)

ROD_LEAKAGE = Effect(
    name="rod_leakage",
    family=_FAMILY,
    summary="The rod's seal weeps to the outside.",
    equation="Q_B,out = k·p_B/µ",
    source=_MERRITT,
    terms=(("flow_b_to_outside", lambda m, p: gap_flow(m, p.conductance, m.pressure_b)),),
    parameters=(_conductance(1e-15, 5e-14, "k of the leak: drops to 1e-14 m^3"),),
    other_ways=(_clearance("rod", _of_rod),),
    looks_like="The rod side loses its trapped pressure while the valve is closed; oil on the rod.",
    confused_with=("piston_leakage",),
    needs="a hold with the valve closed, or chamber pressures",
)

#: slip is invisible while flow passes over the relief valve; these values leave none, in hot or in cold oil
_PUMP_WITHOUT_RESERVE = (1e-14, 2e-14, 4e-14)

PUMP_SLIP = Effect(
    name="pump_slip",
    family=_FAMILY,
    summary="Part of the pump's delivery slips back past its gears.",
    equation="Q_slip = k·p_S/µ",
    source="Merritt (1967), section 4-3: laminar slip of positive-displacement pumps",
    terms=(("flow_p_to_tank", lambda m, p: gap_flow(m, p.conductance, m.supply_pressure)),),
    parameters=(
        _conductance(
            3.5e-14,
            1e-12,
            "k of the pump: 6 % at 120 bar and 40 degC is 3.5e-14 m^3",
            grid=_PUMP_WITHOUT_RESERVE,
        ),
    ),
    looks_like=(
        "The supply pressure sags when the cylinder needs nearly all of the pump's flow, more in hot oil; "
        "nothing shows while the relief valve is open."
    ),
    confused_with=("relief_override",),
    needs="runs near the pump's full flow (50 bar on the published bench)",
)

EFFECTS = (PISTON_LEAKAGE, VALVE_LEAKAGE, CAP_LEAKAGE, ROD_LEAKAGE, PUMP_SLIP)
