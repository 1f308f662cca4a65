"""The increase of the oil's viscosity with pressure: two laws, for every family with a viscosity."""

from __future__ import annotations

from collections.abc import Callable

from rigctl.effects.declaration import Effect, EffectParameter, Own
from rigctl.engine.symbols import Scalar
from rigctl.physics import oil
from rigctl.physics.scope import Scope

_A1, _A2, _B1, _B2 = oil.HL32.modulus


def barus(family: str, *, looks_like: str, needs: str) -> Effect:
    """Barus' law at a family's slot ``viscosity``, as a function of its variable ``pressure``."""
    return Effect(
        name="barus",
        family=family,
        summary="Viscosity rises with pressure.",
        equation="µ = µ0·exp(α·p)",
        source="Barus (1893); physics of mineral oils, α about 2e-8 1/Pa",
        terms=(("viscosity", lambda m, p: oil.barus_factor(m.pressure, p.coefficient)),),
        parameters=(EffectParameter("coefficient", "1/Pa", 0.0, 2e-8, 0.0, 1e-7, "α", physical="low"),),
        looks_like=looks_like,
        confused_with=("modulus_viscosity",),
        instead_of=("modulus_viscosity",),
        needs=needs,
    )


def modulus_viscosity(
    family: str, temperature: Callable[[Scope], Scalar], *, looks_like: str, needs: str
) -> Effect:
    """The modulus equation at a family's slot ``viscosity``, at this temperature of the oil."""

    def factor(m: Scope, p: Own) -> Scalar:
        return oil.modulus_factor(p.share * m.pressure, temperature(m), (p.a1, p.a2, p.b1, p.b2))

    share = "of the pressure that acts; 1 is the law as printed"
    return Effect(
        name="modulus_viscosity",
        family=family,
        summary="Viscosity rises with pressure, less in hot oil.",
        equation="µ = µ0·exp(p/(a1 + a2·t + (b1 + b2·t)·p)), t in degC",
        source="Knezevic & Savic, Facta Universitatis, Mechanical Engineering 4(1) (2006)",
        terms=(("viscosity", factor),),
        parameters=(
            EffectParameter("share", "1", 0.0, 1.0, 0.0, 5.0, share, physical="low"),
            EffectParameter("a1", "bar", None, _A1, 100e5, 2000e5, "a1", physical="none"),
            EffectParameter("a2", "bar/K", None, _A2, 0.0, 20e5, "a2", physical="low"),
            EffectParameter("b1", "1", None, _B1, 0.0, 1.0, "b1", physical="low"),
            EffectParameter("b2", "1/K", None, _B2, 0.0, 0.01, "b2", physical="low"),
        ),
        looks_like=looks_like,
        confused_with=("barus",),
        instead_of=("barus",),
        needs=needs,
    )
