"""The oil's viscosity under pressure and its stiffness."""

from __future__ import annotations

from rigctl.effects.declaration import Effect, EffectParameter, Own
from rigctl.effects.oil_pressure import barus, modulus_viscosity
from rigctl.engine.symbols import Scalar, constant_like, positive_part
from rigctl.physics import oil
from rigctl.physics.constants import ATMOSPHERE
from rigctl.physics.scope import Scope

_FAMILY = "hydraulic_cylinder"
_NEEDS_VISCOSITY = "another effect that contains the viscosity, e.g. a leakage; alone it changes nothing"

#: absolute pressure below which the compression of air is rounded off, in Pa
_VACUUM_WIDTH = 2e3

BARUS = barus(
    _FAMILY,
    looks_like="Leakages and viscous losses change a little with pressure: 10 % at 50 bar.",
    needs=_NEEDS_VISCOSITY,
)
MODULUS_VISCOSITY = modulus_viscosity(
    _FAMILY,
    lambda m: m.line_temperature,
    looks_like="As barus, with less of it in hot oil.",
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
