"""Heat losses, thermal lags and heat capacities that the base heat balance lacks."""

from __future__ import annotations

from rigctl.effects.declaration import Effect, EffectParameter, EffectState, Own
from rigctl.effects.lag import reading_error
from rigctl.engine.symbols import Scalar, constant_like
from rigctl.physics.constants import STEFAN_BOLTZMANN
from rigctl.physics.scope import Scope

_FAMILY = "hydraulic_cylinder"
_INCROPERA = "Incropera & DeWitt, Fundamentals of Heat and Mass Transfer"
#: times that a heating record cannot resolve, s
_HEATER_RESOLUTION = 2.0


def _radiation(m: Scope, p: Own) -> Scalar:
    sigma = m.constant(STEFAN_BOLTZMANN, "W/(m^2*K^4)")
    return -(p.area * (sigma * (m.oil_temperature**4 - m.ambient_temperature**4)))


RADIATION_LOSS = Effect(
    name="radiation_loss",
    family=_FAMILY,
    summary="The tank radiates to the room.",
    equation="Q = ε·A·σ·(T⁴ − T_amb⁴)",
    source=_INCROPERA,
    terms=(("heat", _radiation),),
    parameters=(
        EffectParameter("area", "m^2", 0.0, 1.0, 0.0, 20.0, "ε·A, emissivity times surface", physical="low"),
    ),
    looks_like="Heating slows down near its end more than a constant loss explains.",
    confused_with=("wall_heat_capacity", "heater_lag"),
    needs="heating over a wide range; a fitted heat loss hides most of it",
)


def _element_rate(m: Scope, p: Own) -> Scalar:
    return (m.heater_power - p.element) / (p.lag + constant_like(_HEATER_RESOLUTION, p.lag))


HEATER_LAG = Effect(
    name="heater_lag",
    family=_FAMILY,
    summary="The heaters warm up before they warm the oil.",
    equation="τ·dP_oil/dt = P − P_oil",
    source=_INCROPERA + ": lumped capacity of the element",
    terms=(
        (
            "heater_power",
            lambda m, p: reading_error(
                p.element - m.heater_power, p.lag, constant_like(_HEATER_RESOLUTION, p.lag)
            ),
        ),
    ),
    parameters=(EffectParameter("lag", "s", 0.0, 20.0, 0.0, 600.0, "τ", physical="low"),),
    states=(EffectState("element", "W", 10.0, _element_rate, "heat that the element gives off"),),
    looks_like="The temperature continues to rise after the heaters are switched off.",
    confused_with=("thermocouple_lag", "wall_heat_capacity"),
    needs="switching of the heaters in the data",
)

WALL_HEAT_CAPACITY = Effect(
    name="wall_heat_capacity",
    family=_FAMILY,
    summary="The tank's wall absorbs heat and releases it.",
    equation="Q = −C_w·dT_w/dt, τ_w·dT_w/dt = T − T_w",
    source=_INCROPERA + ": lumped capacity of the wall",
    terms=(("heat", lambda m, p: -(p.capacity / p.time * p.difference)),),
    parameters=(
        EffectParameter(
            "capacity", "kJ/K", 0.0, 2e4, 0.0, 5e5, "C_w; 40 kg of steel are 18 kJ/K", physical="low"
        ),
        EffectParameter(
            "time",
            "s",
            None,
            120.0,
            5.0,
            3600.0,
            "τ_w, until the wall follows the oil",
            grid=(20.0, 600.0),
            physical="none",
        ),
    ),
    states=(
        EffectState(
            "difference",
            "K",
            0.1,
            lambda m, p: m.rate("oil_temperature") - p.difference / p.time,
            "oil less wall",
        ),
    ),
    looks_like="Heating is faster at the start than later; the temperature sags after heating stops.",
    confused_with=("heater_lag", "radiation_loss"),
    needs="heating in the data; a fitted fill hides most of it",
)

LINE_OIL_TEMPERATURE = Effect(
    name="line_oil_temperature",
    family=_FAMILY,
    summary="Oil in the cylinder and its lines is nearer to the room's temperature than the tank's oil.",
    equation="T_line = T − k·(T − T_amb)",
    source="heat balance of standing oil in a line; " + _INCROPERA,
    terms=(("line_temperature", lambda m, p: -(p.share * (m.oil_temperature - m.ambient_temperature))),),
    parameters=(
        EffectParameter(
            "share", "%", 0.0, 0.2, 0.0, 0.95, "k, of the way to the room's temperature", physical="both"
        ),
    ),
    looks_like="Everything that depends on the oil's temperature changes less than the thermometer says.",
    confused_with=("thermocouple_offset",),
    needs="records at several oil temperatures, and an effect that contains the viscosity",
)

EFFECTS = (RADIATION_LOSS, HEATER_LAG, WALL_HEAT_CAPACITY, LINE_OIL_TEMPERATURE)
