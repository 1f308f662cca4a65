"""The flow area of the flow-control valve, and the pressure losses in the lines."""

from __future__ import annotations

import math

from rigctl.effects.declaration import Effect, EffectParameter, Own
from rigctl.effects.reference import above_20_celsius
from rigctl.engine.symbols import Scalar
from rigctl.physics.scope import Scope

_FAMILY = "hydraulic_cylinder"

LAMINAR_THROTTLE = Effect(
    name="laminar_throttle",
    family=_FAMILY,
    summary="At low Reynolds numbers the throttle passes less than its turbulent law says.",
    equation="A_t·Re/(Re + Re_t), Re = d·sqrt(2·|Δp|/ρ)/ν",
    source="Merritt, Hydraulic Control Systems (1967), section 3-4: laminar flow in orifices",
    terms=(("throttle_area", lambda m, p: 1.0 / (1.0 + p.transition_reynolds / m.reynolds)),),
    parameters=(
        EffectParameter(
            "transition_reynolds",
            "1",
            null=0.0,
            start=100.0,
            low=0.0,
            high=2e3,
            meaning="Re_t, where half of the area is lost; 20 (sharp edge) to 300 (long throttle)",
            physical="low",
        ),
    ),
    looks_like="Strokes grow as the oil warms and thins, most at low supply pressure.",
    confused_with=("viscous_friction", "line_loss", "flow_area_thermal_drift"),
    needs="records at several oil temperatures",
)

FLOW_AREA_THERMAL_DRIFT = Effect(
    name="flow_area_thermal_drift",
    family=_FAMILY,
    summary="The throttle's opening changes with the oil's temperature.",
    equation="A_t·(1 + k·(T − 20 degC))",
    source="Hashim, Al-Salihi & Al Zubaidi: one of four effects that their strokes cannot tell apart",
    terms=(("throttle_area", lambda m, p: 1.0 + p.coefficient * above_20_celsius(m.line_temperature)),),
    parameters=(
        EffectParameter(
            "coefficient",
            "1/K",
            null=0.0,
            start=-1e-3,
            low=-1e-2,
            high=1e-2,
            meaning="k; 7 % smaller at 60 degC is -1.75e-3",
            physical="none",
        ),
    ),
    looks_like="Both speeds change with temperature, by one share at every pressure.",
    confused_with=("relief_thermal_drift", "position_thermal_drift", "laminar_throttle"),
    needs="records at several oil temperatures",
)


def _bore_area(p: Own) -> Scalar:
    return math.pi / 4.0 * p.bore**2


def _laminar(m: Scope, p: Own) -> Scalar:
    return 128.0 * m.viscosity * p.length / (math.pi * p.bore**4)


def _turbulent(m: Scope, p: Own) -> Scalar:
    return p.loss_coefficient * m.density / (2.0 * _bore_area(p) ** 2)


LINE_LOSS = Effect(
    name="line_loss",
    family=_FAMILY,
    summary="The cylinder's lines take a share of the pressure, laminar in the pipe, turbulent in fittings.",
    equation="Δp = 128·µ·l·Q/(π·d⁴) + ζ·ρ·w²/2, in each line",
    source="Hagen-Poiseuille; Merritt (1967), sections 3-1 and 3-3",
    terms=(("line_resistance", _laminar), ("line_turbulence", _turbulent)),
    parameters=(
        EffectParameter("length", "m", 0.0, 2.0, 0.0, 50.0, "l of each line", physical="low"),
        EffectParameter(
            "loss_coefficient", "1", 0.0, 5.0, 0.0, 200.0, "ζ, sum of bends and fittings", physical="low"
        ),
        EffectParameter("bore", "mm", None, 8e-3, 2e-3, 50e-3, "d of each line", physical="none"),
    ),
    looks_like="Slower in cold oil, in proportion to the speed; the chambers see less than the valve gives.",
    confused_with=("viscous_friction", "laminar_throttle"),
    needs="records at several oil temperatures",
)

EFFECTS = (LAMINAR_THROTTLE, FLOW_AREA_THERMAL_DRIFT, LINE_LOSS)
