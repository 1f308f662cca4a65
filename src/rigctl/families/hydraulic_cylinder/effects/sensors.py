"""Measurement errors of the sensors.

Terms at the slots of readings only: what the bench does is unchanged. Lags and slack have states of their
own; the other terms are proportional to their parameter. Where a fitted parameter of the model or the start
of a record does the same to the readings, `needs` says what else would show the error.
"""

from __future__ import annotations

from rigctl.effects.declaration import Effect, EffectParameter, EffectState, Own
from rigctl.effects.lag import deviation_rate, reading_error
from rigctl.effects.reference import above_20_celsius
from rigctl.engine.symbols import Scalar, constant_like, tanh
from rigctl.physics.scope import Scope

_FAMILY = "hydraulic_cylinder"
_JCGM = "JCGM 200 (VIM): measurement errors of an indicating instrument"

#: travel over which the slack of a coupling is taken up, besides the slack itself, in m
_TAKE_UP = 0.1e-3
#: speed below which a coupling stays on its side of the slack, in m/s
_STILL = 1e-4
#: times that the sampling cannot resolve, s
_PRESSURE_RESOLUTION = 2e-3
_THERMOCOUPLE_RESOLUTION = 0.2


def _play_rate(m: Scope, p: Own) -> Scalar:
    # ds/dt = v·(1 − 2·s·sign(v))/(h + 0.1 mm): s tends to ±1/2 over the travel h + 0.1 mm, not over a time.
    # The 0.1 mm keep the rate finite at h = 0, where the effect is off and s has no influence.
    still = constant_like(_STILL, m.velocity)
    travel = p.width + constant_like(_TAKE_UP, m.position)
    return (m.velocity - 2.0 * p.side * m.velocity * tanh(m.velocity / still)) / travel


POSITION_BACKLASH = Effect(
    name="position_backlash",
    family=_FAMILY,
    summary="Slack in the position sensor's coupling: it reads behind the motion, on either side.",
    equation="x_read = x − h·s, ds/dt = v·(1 − 2·s·sign(v))/(h + 0.1 mm), |s| ≤ 1/2",
    source="Dahl's model of hysteresis (1968), as a smooth play",
    terms=(("position_reading", lambda m, p: -(p.width * p.side)),),
    parameters=(EffectParameter("width", "mm", 0.0, 0.3e-3, 0.0, 5e-3, "h, the slack", physical="low"),),
    states=(EffectState("side", "1", 0.1, _play_rate, "s, which side of the slack", start=-0.5),),
    kind="sensor",
    looks_like="Extension and retraction disagree by a constant; the reading starts and returns late.",
    confused_with=("valve_open_delay", "position_offset"),
    needs="motion in both directions in one record",
)

POSITION_GAIN = Effect(
    name="position_gain",
    family=_FAMILY,
    summary="The position sensor's gain is wrong.",
    equation="x_read = x·(1 + k)",
    source=_JCGM,
    terms=(("position_reading", lambda m, p: p.error * m.position),),
    parameters=(EffectParameter("error", "%", 0.0, 0.01, -0.2, 0.2, "k", physical="none"),),
    kind="sensor",
    looks_like="Strokes are off by one share, whatever the pressure and temperature.",
    confused_with=("flow_area_thermal_drift", "position_thermal_drift"),
    needs="an independent reference: a fitted flow area hides most of it",
)

POSITION_OFFSET = Effect(
    name="position_offset",
    family=_FAMILY,
    summary="The position sensor's zero is off.",
    equation="x_read = x + c",
    source=_JCGM,
    terms=(("position_reading", lambda m, p: p.offset),),
    parameters=(EffectParameter("offset", "mm", 0.0, 1e-3, -50e-3, 50e-3, "c", physical="none"),),
    kind="sensor",
    looks_like="Every reading is off by the same length.",
    confused_with=("position_backlash",),
    needs="a known position, e.g. the retracted end stop; a fitted start position hides it",
)

POSITION_THERMAL_DRIFT = Effect(
    name="position_thermal_drift",
    family=_FAMILY,
    summary="The position sensor's gain drifts with the oil temperature.",
    equation="x_read = x·(1 + k·(T − 20 degC))",
    source="Hashim, Al-Salihi & Al Zubaidi: one of four effects that their strokes cannot tell apart",
    terms=(
        ("position_reading", lambda m, p: p.coefficient * above_20_celsius(m.oil_temperature) * m.position),
    ),
    parameters=(EffectParameter("coefficient", "1/K", 0.0, -1e-3, -1e-2, 1e-2, "k", physical="none"),),
    kind="sensor",
    looks_like="Strokes change by a share that grows with temperature, at every pressure alike.",
    confused_with=("flow_area_thermal_drift", "relief_thermal_drift", "valve_leakage"),
    needs="records at several oil temperatures",
)

PRESSURE_GAIN = Effect(
    name="pressure_gain",
    family=_FAMILY,
    summary="The supply transducer's gain is wrong.",
    equation="p_read = p_S·(1 + k)",
    source=_JCGM,
    terms=(("supply_pressure_reading", lambda m, p: p.error * m.supply_pressure),),
    parameters=(EffectParameter("error", "%", 0.0, 0.01, -0.2, 0.2, "k", physical="none"),),
    kind="sensor",
    looks_like="The supply reads a share above or below its setting.",
    confused_with=("pressure_offset", "relief_thermal_drift"),
)

PRESSURE_OFFSET = Effect(
    name="pressure_offset",
    family=_FAMILY,
    summary="The supply transducer's zero is off.",
    equation="p_read = p_S + c",
    source=_JCGM,
    terms=(("supply_pressure_reading", lambda m, p: p.offset),),
    parameters=(EffectParameter("offset", "bar", 0.0, 0.5e5, -10e5, 10e5, "c", physical="none"),),
    kind="sensor",
    looks_like="The supply reads a constant above or below its setting.",
    confused_with=("pressure_gain", "relief_override"),
)

PRESSURE_LAG = Effect(
    name="pressure_lag",
    family=_FAMILY,
    summary="The supply transducer, or its damping, reads late.",
    equation="τ·dp_read/dt = p_S − p_read",
    source="first-order lag of an instrument line; Jelali & Kroll (2003)",
    terms=(
        (
            "supply_pressure_reading",
            lambda m, p: reading_error(p.deviation, p.lag, constant_like(_PRESSURE_RESOLUTION, p.lag)),
        ),
    ),
    parameters=(EffectParameter("lag", "ms", 0.0, 20e-3, 0.0, 2.0, "τ", physical="low"),),
    states=(
        EffectState(
            "deviation",
            "Pa",
            1e5,
            lambda m, p: deviation_rate(
                p.deviation, p.lag, constant_like(_PRESSURE_RESOLUTION, p.lag), m.rate("supply_pressure")
            ),
            "reading less truth, of the unweighted lag",
        ),
    ),
    kind="sensor",
    looks_like="The dips of the supply pressure are late and rounded.",
    confused_with=("entrained_air", "hose_compliance"),
)

THERMOCOUPLE_LAG = Effect(
    name="thermocouple_lag",
    family=_FAMILY,
    summary="The thermocouple in its well reads late.",
    equation="τ·dT_read/dt = T − T_read",
    source="first-order lag of a thermowell; Doebelin, Measurement Systems",
    terms=(
        (
            "oil_temperature_reading",
            lambda m, p: reading_error(p.deviation, p.lag, constant_like(_THERMOCOUPLE_RESOLUTION, p.lag)),
        ),
    ),
    parameters=(EffectParameter("lag", "s", 0.0, 10.0, 0.0, 300.0, "τ; 1 to 30 s", physical="low"),),
    states=(
        EffectState(
            "deviation",
            "K",
            0.1,
            lambda m, p: deviation_rate(
                p.deviation, p.lag, constant_like(_THERMOCOUPLE_RESOLUTION, p.lag), m.rate("oil_temperature")
            ),
            "reading less truth, of the unweighted lag",
        ),
    ),
    kind="sensor",
    looks_like="The temperature follows heating and switching off late.",
    confused_with=("heater_lag", "wall_heat_capacity"),
    needs="heating in the data",
)

THERMOCOUPLE_OFFSET = Effect(
    name="thermocouple_offset",
    family=_FAMILY,
    summary="The thermocouple's zero is off.",
    equation="T_read = T + c",
    source=_JCGM,
    terms=(("oil_temperature_reading", lambda m, p: p.offset),),
    parameters=(
        EffectParameter("offset", "K", 0.0, 1.0, -20.0, 20.0, "c", difference=True, physical="none"),
    ),
    kind="sensor",
    looks_like="Every temperature is off by the same amount; the oil seems too thick or too thin.",
    confused_with=("line_oil_temperature",),
    needs="an effect that contains the viscosity, or a second thermometer; a fitted start hides it",
)

EFFECTS = (
    POSITION_BACKLASH,
    POSITION_GAIN,
    POSITION_OFFSET,
    POSITION_THERMAL_DRIFT,
    PRESSURE_GAIN,
    PRESSURE_OFFSET,
    PRESSURE_LAG,
    THERMOCOUPLE_LAG,
    THERMOCOUPLE_OFFSET,
)
