"""The oil's viscosity under pressure and its stiffness."""

from __future__ import annotations

from rigctl.effects.declaration import Effect, EffectParameter, Own
from rigctl.engine.symbols import Scalar, constant_like, positive_part
from rigctl.physics import oil
from rigctl.physics.constants import ATMOSPHERE
from rigctl.physics.scope import Scope

_FAMILY = "hydraulic_cylinder"
_NEEDS_VISCOSITY = "another effect that contains the viscosity, e.g. a leakage; alone it changes nothing"

#: absolute pressure below which the compression of air is rounded off, in Pa
_VACUUM_WIDTH = 2e3

_A1, _A2, _B1, _B2 = oil.HL32.modulus

BARUS = Effect(
    name="barus",
    family=_FAMILY,
    summary="Viscosity rises with pressure.",
    equation="µ = µ0·exp(α·p)",
    source="Barus (1893); physics of mineral oils, α about 2e-8 1/Pa",
    terms=(("viscosity", lambda m, p: oil.barus_factor(m.pressure, p.coefficient)),),
    parameters=(EffectParameter("coefficient", "1/Pa", 0.0, 2e-8, 0.0, 1e-7, "α", physical="low"),),
    looks_like="Leakages and viscous losses change a little with pressure: 10 % at 50 bar.",
    confused_with=("modulus_viscosity",),
    instead_of=("modulus_viscosity",),
    needs=_NEEDS_VISCOSITY,
)


def _modulus(m: Scope, p: Own) -> Scalar:
    return oil.modulus_factor(p.share * m.pressure, m.line_temperature, (p.a1, p.a2, p.b1, p.b2))


MODULUS_VISCOSITY = Effect(
    name="modulus_viscosity",
    family=_FAMILY,
    summary="Viscosity rises with pressure, less in hot oil.",
    equation="µ = µ0·exp(p/(a1 + a2·t + (b1 + b2·t)·p)), t in degC",
    source="Knezevic & Savic, Facta Universitatis, Mechanical Engineering 4(1) (2006)",
    terms=(("viscosity", _modulus),),
    parameters=(
        EffectParameter(
            "share",
            "1",
            0.0,
            1.0,
            0.0,
            5.0,
            "of the pressure that acts; 1 is the law as printed",
            physical="low",
        ),
        EffectParameter("a1", "bar", None, _A1, 100e5, 2000e5, "a1", physical="none"),
        EffectParameter("a2", "bar/K", None, _A2, 0.0, 20e5, "a2", physical="low"),
        EffectParameter("b1", "1", None, _B1, 0.0, 1.0, "b1", physical="low"),
        EffectParameter("b2", "1/K", None, _B2, 0.0, 0.01, "b2", physical="low"),
    ),
    looks_like="As barus, with less of it in hot oil.",
    confused_with=("barus",),
    instead_of=("barus",),
    needs=_NEEDS_VISCOSITY,
)


def _air(m: Scope, p: Own) -> Scalar:
    absolute = positive_part(m.pressure + constant_like(ATMOSPHERE, m.pressure), _VACUUM_WIDTH)
    return oil.air_compliance(absolute, p.fraction, m.bulk_modulus)


ENTRAINED_AIR = Effect(
    name="entrained_air",
    family=_FAMILY,
    summary="Undissolved air softens the oil, most at low pressure.",
    equation="1/β_eff = −(dV/dp)/V of V = (1 − x0) + x0·(p_atm/p)^(1/1.4)",
    source="Jelali & Kroll, Hydraulic Servo-systems (2003), section 3.2",
    terms=(("compliance", _air),),
    parameters=(
        EffectParameter(
            "fraction", "%", 0.0, 5e-3, 0.0, 0.1, "x0, free air at atmospheric pressure", physical="both"
        ),
    ),
    looks_like="Motion starts and stops late and softly; pressures build up slowly from tank pressure.",
    confused_with=("hose_compliance", "valve_open_delay"),
)

HOSE_COMPLIANCE = Effect(
    name="hose_compliance",
    family=_FAMILY,
    summary="Hoses widen under pressure and add to the oil's own compliance.",
    equation="1/β_eff = 1/β + c",
    source="Merritt (1967), section 2-4: mechanical compliance in series",
    terms=(("compliance", lambda m, p: p.compliance),),
    parameters=(
        EffectParameter(
            "compliance",
            "1/Pa",
            0.0,
            3e-10,
            0.0,
            1e-8,
            "c, relative growth of volume per pressure",
            physical="low",
        ),
    ),
    looks_like="Motion starts and stops softly, the same at every pressure.",
    confused_with=("entrained_air",),
)

EFFECTS = (BARUS, MODULUS_VISCOSITY, ENTRAINED_AIR, HOSE_COMPLIANCE)
