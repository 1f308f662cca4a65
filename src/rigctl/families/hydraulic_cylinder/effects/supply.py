"""The relief valve, which sets the supply pressure."""

from __future__ import annotations

from rigctl.effects.declaration import Effect, EffectParameter
from rigctl.effects.reference import above_20_celsius

_FAMILY = "hydraulic_cylinder"

RELIEF_OVERRIDE = Effect(
    name="relief_override",
    family=_FAMILY,
    summary="The relief pressure rises with its flow by more than in the base model.",
    equation="R + k in Q_relief = max(0, Q_pump + (p_S − p_set)/(R + k))",
    source="Merritt, Hydraulic Control Systems (1967), section 9-3: direct-operated relief valves",
    terms=(("relief_resistance", lambda m, p: p.resistance),),
    parameters=(
        EffectParameter(
            "resistance",
            "Pa*s/m^3",
            null=0.0,
            start=1e9,
            low=0.0,
            high=2e10,
            meaning="k: 1 to 5 bar over 14 l/min is 4e8 to 2e9",
            physical="low",
        ),
    ),
    looks_like="The supply pressure drops while the cylinder moves, in proportion to the flow it takes.",
    confused_with=("pump_slip", "flow_area_thermal_drift"),
)

RELIEF_THERMAL_DRIFT = Effect(
    name="relief_thermal_drift",
    family=_FAMILY,
    summary="The setting of the relief valve drifts with the oil temperature.",
    equation="p_set·(1 − k·(T − 20 degC))",
    source="Jelali & Kroll, Hydraulic Servo-systems (2003): spring and seat of direct-operated valves",
    terms=(("relief_setting", lambda m, p: 1.0 - p.coefficient * above_20_celsius(m.line_temperature)),),
    parameters=(
        EffectParameter(
            "coefficient",
            "1/K",
            null=0.0,
            start=1e-3,
            low=-1e-2,
            high=1e-2,
            meaning="k, share of the setting that is lost per kelvin",
            physical="none",
        ),
    ),
    looks_like="The supply pressure at rest falls as the oil warms; strokes fall with its square root.",
    confused_with=("pressure_gain", "flow_area_thermal_drift", "position_thermal_drift"),
    needs="records at several oil temperatures",
)

EFFECTS = (RELIEF_OVERRIDE, RELIEF_THERMAL_DRIFT)
