"""The delay between the valve's command and its motion, at every switch of both strokes."""

from __future__ import annotations

from rigctl.effects.declaration import Effect, EffectParameter, Own
from rigctl.effects.reference import above_20_celsius
from rigctl.engine.symbols import Scalar
from rigctl.physics.scope import Scope

_FAMILY = "hydraulic_cylinder"
_VALVE = "Jelali & Kroll, Hydraulic Servo-systems (2003): switching times of solenoid valves, 5 to 80 ms"


def opens(m: Scope) -> Scalar:
    """1 for a command away from neutral, 0 for one back to it; the command is -1, 0 or 1."""
    return m.after**2


def _thermal(m: Scope, p: Own) -> Scalar:
    return p.coefficient * above_20_celsius(m.oil_temperature) * opens(m)


VALVE_OPEN_DELAY = Effect(
    name="valve_open_delay",
    family=_FAMILY,
    summary="The valve opens with a delay after its command.",
    equation="τ = τ_open at each command away from neutral",
    source=_VALVE,
    terms=(("valve_delay", lambda m, p: p.delay * opens(m)),),
    parameters=(EffectParameter("delay", "ms", 0.0, 20e-3, 0.0, 0.3, "τ_open", physical="low"),),
    looks_like="Strokes start late and are shorter by speed times delay.",
    confused_with=("entrained_air", "valve_close_delay", "position_offset"),
)

VALVE_CLOSE_DELAY = Effect(
    name="valve_close_delay",
    family=_FAMILY,
    summary="The valve closes with a delay after its command.",
    equation="τ = τ_close at each command to neutral",
    source=_VALVE,
    terms=(("valve_delay", lambda m, p: p.delay * (1.0 - opens(m))),),
    parameters=(EffectParameter("delay", "ms", 0.0, 20e-3, 0.0, 0.3, "τ_close", physical="low"),),
    looks_like="Strokes end late and are longer by speed times delay.",
    confused_with=("valve_open_delay", "position_offset"),
)

VALVE_DELAY_THERMAL = Effect(
    name="valve_delay_thermal",
    family=_FAMILY,
    summary="The valve opens later in hot oil (a solenoid weakens as it warms).",
    equation="τ = k·(T − 20 degC) at each command away from neutral",
    source="Hashim, Al-Salihi & Al Zubaidi: one of four effects that their strokes cannot tell apart",
    terms=(("valve_delay", _thermal),),
    parameters=(
        EffectParameter(
            "coefficient", "ms/K", 0.0, 1e-3, -5e-3, 5e-3, "k; 75 ms at 60 degC is 1.9 ms/K", physical="none"
        ),
    ),
    looks_like="Strokes shorten as the oil warms, by a time and not by a share.",
    confused_with=("flow_area_thermal_drift", "relief_thermal_drift", "position_thermal_drift"),
    needs="records at several oil temperatures",
)

EFFECTS = (VALVE_OPEN_DELAY, VALVE_CLOSE_DELAY, VALVE_DELAY_THERMAL)
