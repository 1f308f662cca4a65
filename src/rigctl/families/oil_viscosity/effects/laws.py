"""Alternative laws of viscosity and density."""

from __future__ import annotations

from rigctl.effects.declaration import Effect, EffectParameter, Own
from rigctl.effects.oil_pressure import barus, modulus_viscosity
from rigctl.engine.symbols import Scalar, constant_like, exp, log
from rigctl.physics import oil
from rigctl.physics.oil.density import REFERENCE_TEMPERATURE
from rigctl.physics.scope import Scope

_FAMILY = "oil_viscosity"

#: Walther's constants from the points of HL32 at 40 and 100 degC, 33.81 and 5.74 cSt
_WALTHER_A, _WALTHER_B = oil.walther_constants(313.15, 33.81e-6, 373.15, 5.74e-6)

BARUS = barus(
    _FAMILY,
    looks_like="The logarithm of viscosity rises in proportion to pressure, at every temperature alike.",
    needs="measurements under pressure",
)
MODULUS_VISCOSITY = modulus_viscosity(
    _FAMILY,
    lambda m: m.temperature,
    looks_like="As barus, with less of it in hot oil and at high pressure.",
    needs="measurements under pressure at several temperatures",
)


def _walther(m: Scope, p: Own) -> Scalar:
    # Slots multiply Vogel's law, so another law enters as the ratio of the two, (ν_W/ν_V)^share: exactly 1 at
    # share 0 and Walther's law at share 1.
    vogel = oil.vogel(m.temperature, m.vogel_a, m.vogel_b, m.vogel_c) / m.true_density
    squared_metres = constant_like(1.0, vogel)
    ratio = oil.walther(m.temperature, p.a, p.b) * squared_metres / vogel
    return exp(p.share * log(ratio))


WALTHER = Effect(
    name="walther",
    family=_FAMILY,
    summary="The double-log law of ASTM D341 instead of Vogel's.",
    equation="log10(log10(ν + 0.7)) = A − B·log10(T), ν in cSt, T in K",
    source="ASTM D341",
    terms=(("viscosity", _walther),),
    parameters=(
        EffectParameter(
            "share", "1", 0.0, 1.0, 0.0, 1.0, "0 is Vogel's law, 1 is Walther's", physical="both"
        ),
        EffectParameter("a", "1", None, _WALTHER_A, 2.0, 20.0, "A", physical="none"),
        EffectParameter("b", "1", None, _WALTHER_B, 1.0, 8.0, "B", physical="none"),
    ),
    looks_like="The curve bends a little less than Vogel's at the cold and the hot end.",
    confused_with=("capillary_end_correction", "thermometer_offset"),
    needs="measurements over a wide range of temperatures",
)


def _curvature(m: Scope, p: Own) -> Scalar:
    above = m.temperature - constant_like(REFERENCE_TEMPERATURE, m.temperature)
    return 1.0 + p.coefficient * above**2


DENSITY_CURVATURE = Effect(
    name="density_curvature",
    family=_FAMILY,
    summary="Density does not fall in a straight line.",
    equation="ρ·(1 + k·(T − 15 degC)²)",
    source="API MPMS 11.1: second-order volume correction",
    terms=(("density", _curvature),),
    parameters=(EffectParameter("coefficient", "1/K^2", 0.0, -3e-7, -1e-5, 1e-5, "k", physical="none"),),
    looks_like="Density bends; kinematic viscosity hardly shows it.",
    confused_with=("walther",),
    needs="measured densities",
)

EFFECTS = (BARUS, MODULUS_VISCOSITY, WALTHER, DENSITY_CURVATURE)
