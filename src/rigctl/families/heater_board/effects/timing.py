"""Delays, lags and drifts of temperatures."""

from __future__ import annotations

from rigctl.effects.declaration import Effect, EffectParameter, EffectState, Own, Term
from rigctl.effects.lag import deviation_rate, reading_error
from rigctl.engine.symbols import Scalar, constant_like
from rigctl.families.heater_board.equations import HEATERS
from rigctl.physics.scope import Scope

_FAMILY = "heater_board"
_LUMP = "Incropera & DeWitt, Fundamentals of Heat and Mass Transfer: lumped capacitance"
#: times that sampling once a second cannot resolve, s
_RESOLUTION = 0.5


def _resolution(lag: Scalar) -> Scalar:
    return constant_like(_RESOLUTION, lag)


def _sensor(number: int) -> tuple[str, Term]:
    def error(m: Scope, p: Own) -> Scalar:
        return reading_error(p[f"deviation_{number}"], p.lag, _resolution(p.lag))

    return f"temperature_{number}_reading", error


def _sensor_state(number: int) -> EffectState:
    def rate(m: Scope, p: Own) -> Scalar:
        deviation = p[f"deviation_{number}"]
        return deviation_rate(deviation, p.lag, _resolution(p.lag), m.rate(f"temperature_{number}"))

    return EffectState(f"deviation_{number}", "K", 0.1, rate, f"reading {number} less truth, unweighted")


SENSOR_LAG = Effect(
    name="sensor_lag",
    family=_FAMILY,
    summary="The thermometers follow their heaters late.",
    equation="τ·dT_read/dt = T − T_read",
    source=_LUMP,
    terms=tuple(_sensor(n) for n in HEATERS),
    parameters=(EffectParameter("lag", "s", 0.0, 20.0, 0.0, 200.0, "τ; 10 to 40 s", physical="low"),),
    states=tuple(_sensor_state(n) for n in HEATERS),
    kind="sensor",
    looks_like="A temperature starts to rise some time after its heater is switched on.",
    confused_with=("heater_lag", "wall_heat_capacity"),
)


def _element(number: int) -> tuple[str, Term]:
    def missing(m: Scope, p: Own) -> Scalar:
        given = p[f"element_{number}"]
        linear = m[f"heater_gain_{number}"] * m[f"heater_{number}"]
        return reading_error(given - linear, p.lag, _resolution(p.lag))

    return f"heater_power_{number}", missing


def _element_state(number: int) -> EffectState:
    def rate(m: Scope, p: Own) -> Scalar:
        linear = m[f"heater_gain_{number}"] * m[f"heater_{number}"]
        return (linear - p[f"element_{number}"]) / (p.lag + _resolution(p.lag))

    return EffectState(f"element_{number}", "W", 1e-2, rate, f"heat that element {number} gives off")


HEATER_LAG = Effect(
    name="heater_lag",
    family=_FAMILY,
    summary="The heaters' elements warm up before they warm the board.",
    equation="τ·dP_out/dt = α·Q − P_out",
    source=_LUMP,
    terms=tuple(_element(n) for n in HEATERS),
    parameters=(EffectParameter("lag", "s", 0.0, 10.0, 0.0, 200.0, "τ", physical="low"),),
    states=tuple(_element_state(n) for n in HEATERS),
    looks_like="A temperature continues to rise after its heater is switched off.",
    confused_with=("sensor_lag", "wall_heat_capacity"),
)


def _wall(number: int) -> tuple[str, Term]:
    def heat(m: Scope, p: Own) -> Scalar:
        return -(p.capacity / p.time * p[f"difference_{number}"])

    return f"heat_{number}", heat


def _wall_state(number: int) -> EffectState:
    def rate(m: Scope, p: Own) -> Scalar:
        return m.rate(f"temperature_{number}") - p[f"difference_{number}"] / p.time

    return EffectState(f"difference_{number}", "K", 0.1, rate, f"heater {number} less the board beneath it")


WALL_HEAT_CAPACITY = Effect(
    name="wall_heat_capacity",
    family=_FAMILY,
    summary="The board beneath each heater absorbs heat and releases it.",
    equation="Q = −C_w·dT_w/dt, τ_w·dT_w/dt = T − T_w",
    source=_LUMP,
    terms=tuple(_wall(n) for n in HEATERS),
    parameters=(
        EffectParameter("capacity", "J/K", 0.0, 1.0, 0.0, 100.0, "C_w", physical="low"),
        EffectParameter(
            "time",
            "s",
            None,
            60.0,
            5.0,
            2000.0,
            "τ_w, until the board follows",
            grid=(20.0, 300.0),
            physical="none",
        ),
    ),
    states=tuple(_wall_state(n) for n in HEATERS),
    looks_like="Heating is faster at the start than later, as with two time constants.",
    confused_with=("sensor_lag", "heater_lag"),
)

AMBIENT_DRIFT = Effect(
    name="ambient_drift",
    family=_FAMILY,
    summary="The room's temperature drifts during the record.",
    equation="Ta + k·t",
    source="heat balance of the room",
    terms=(("ambient", lambda m, p: p.rate * p.elapsed),),
    parameters=(
        EffectParameter("rate", "K/h", 0.0, 1.0 / 3600.0, -0.01, 0.01, "k", difference=True, physical="none"),
    ),
    states=(EffectState("elapsed", "s", 1.0, lambda m, p: 1.0, "time since the record began"),),
    looks_like="Both temperatures wander together, in hours.",
    confused_with=("heater_coupling",),
    needs="records of an hour or more",
)

EFFECTS = (SENSOR_LAG, HEATER_LAG, WALL_HEAT_CAPACITY, AMBIENT_DRIFT)
