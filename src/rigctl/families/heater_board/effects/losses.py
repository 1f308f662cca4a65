"""Heat losses besides linear convection."""

from __future__ import annotations

from rigctl.effects.declaration import Effect, EffectParameter, Own, Term
from rigctl.engine.symbols import Scalar, absolute, constant_like, power
from rigctl.physics.constants import STEFAN_BOLTZMANN
from rigctl.physics.scope import Scope

_FAMILY = "heater_board"
_INCROPERA = "Incropera & DeWitt, Fundamentals of Heat and Mass Transfer"

#: temperature difference at which the power law equals the linear one, in K
_REFERENCE_DIFFERENCE = 30.0


def radiated(m: Scope, area: Scalar, hot: Scalar, cold: Scalar) -> Scalar:
    """``A * sigma * (T1^4 - T2^4)``, A being emissivity times surface."""
    return area * (m.constant(STEFAN_BOLTZMANN, "W/(m^2*K^4)") * (hot**4 - cold**4))


def _to_room(number: int) -> tuple[str, Term]:
    def term(m: Scope, p: Own) -> Scalar:
        return -radiated(m, p.area, m[f"temperature_{number}"], m.room_temperature)

    return f"heat_{number}", term


RADIATION = Effect(
    name="radiation",
    family=_FAMILY,
    summary="The heaters radiate to the room.",
    equation="Q = ε·A·σ·(T⁴ − Ta⁴)",
    source=_INCROPERA,
    terms=(_to_room(1), _to_room(2)),
    parameters=(
        EffectParameter(
            "area", "cm^2", 0.0, 9e-4, 0.0, 0.05, "ε·A, emissivity times surface", physical="low"
        ),
    ),
    looks_like="High temperatures stay below what a constant heat loss explains.",
    confused_with=("power_law_convection", "heater_nonlinearity"),
    needs="steady states at several powers",
)


def _between(number: int) -> tuple[str, Term]:
    def term(m: Scope, p: Own) -> Scalar:
        # The term at each heater is minus the other's: what one loses, the other gains.
        temperature, other = m[f"temperature_{number}"], m[f"temperature_{3 - number}"]
        return p.conductance * (other - temperature) + radiated(m, p.area, other, temperature)

    return f"heat_{number}", term


HEATER_COUPLING = Effect(
    name="heater_coupling",
    family=_FAMILY,
    summary="The heaters warm one another, through the board and by radiation.",
    equation="Q12 = G·(T2 − T1) + ε·A·σ·(T2⁴ − T1⁴)",
    source=_INCROPERA,
    terms=(_between(1), _between(2)),
    parameters=(
        EffectParameter("conductance", "W/K", 0.0, 2e-3, 0.0, 0.2, "G", physical="low"),
        EffectParameter("area", "cm^2", 0.0, 2e-4, 0.0, 0.01, "ε·A between the heaters", physical="low"),
    ),
    looks_like="A heater that is off warms up when the other is on.",
    confused_with=("ambient_drift", "wall_heat_capacity"),
    needs="records in which the two heaters differ",
)


def _power_law(m: Scope, p: Own) -> Scalar:
    # The size of the effect is the exponent itself, 0 when it is off. The reference of 30 K is where the law
    # with any n equals the linear one, so that n bends the loss without changing its level there.
    size = absolute(m.difference, 0.1)
    return power(size / constant_like(_REFERENCE_DIFFERENCE, m.difference), p.exponent)


POWER_LAW_CONVECTION = Effect(
    name="power_law_convection",
    family=_FAMILY,
    summary="Free convection grows faster than the temperature difference.",
    equation="Q = U·ΔT·(|ΔT|/30 K)^n",
    source=_INCROPERA + ": n = 1/4 laminar, 1/3 turbulent",
    terms=(("convection", _power_law),),
    parameters=(EffectParameter("exponent", "1", 0.0, 0.25, -0.5, 1.0, "n", physical="none"),),
    looks_like="High temperatures stay below, low ones above, what a constant heat loss explains.",
    confused_with=("radiation", "heater_nonlinearity"),
    needs="steady states at several powers",
)

HEATER_NONLINEARITY = Effect(
    name="heater_nonlinearity",
    family=_FAMILY,
    summary="A heater's power is not proportional to its command.",
    equation="P = α·Q·(1 + k·(1 − Q))",
    source="transistor output stage of the board; k bends the characteristic between its ends",
    terms=(("heater_gain", lambda m, p: 1.0 + p.bend * (1.0 - m.command)),),
    parameters=(EffectParameter("bend", "1", 0.0, 0.1, -1.0, 1.0, "k", physical="both"),),
    looks_like="Half commands give more or less than half the rise.",
    confused_with=("radiation", "power_law_convection"),
    needs="several commands between 0 and 100 %",
)

EFFECTS = (RADIATION, HEATER_COUPLING, POWER_LAW_CONVECTION, HEATER_NONLINEARITY)
