"""Forces of the seals and of the oil film, against the motion.

A force that flips with the direction is written with ``tanh(v / v_s)``: it creeps where real friction
sticks, and cannot hold a load.
"""

from __future__ import annotations

from rigctl.effects.declaration import Effect, EffectParameter, Own
from rigctl.engine.symbols import Scalar, exp, positive_part, tanh
from rigctl.physics.scope import Scope

_FAMILY = "hydraulic_cylinder"
_JELALI = "Jelali & Kroll, Hydraulic Servo-systems (2003), section 3.4"

#: chamber pressure below which a seal's load is rounded to zero, in Pa
_SEAL_WIDTH = 1e4


def _velocity() -> EffectParameter:
    return EffectParameter(
        "velocity",
        "mm/s",
        None,
        2e-3,
        1e-4,
        50e-3,
        "v_s, width of the change of direction",
        grid=(0.5e-3, 10e-3),
    )


def direction(m: Scope, p: Own) -> Scalar:
    """``tanh(v / v_s)``: the sign of the motion, rounded."""
    return tanh(m.velocity / p.velocity)


VISCOUS_FRICTION = Effect(
    name="viscous_friction",
    family=_FAMILY,
    summary="The oil film drags in proportion to speed and viscosity.",
    equation="F = k·µ·v",
    source=_JELALI + "; a film of area A and thickness h has k = A/h",
    terms=(("friction", lambda m, p: p.coefficient * m.viscosity * m.velocity),),
    parameters=(EffectParameter("coefficient", "m", 0.0, 500.0, 0.0, 2e4, "k; 240 (20 um film) to 2500 m"),),
    looks_like="Slower in cold oil, in proportion to speed.",
    confused_with=("laminar_throttle", "line_loss"),
    needs="records at several oil temperatures",
)

COULOMB_FRICTION = Effect(
    name="coulomb_friction",
    family=_FAMILY,
    summary="The seals drag with a constant force against the motion.",
    equation="F = F_c·tanh(v/v_s)",
    source=_JELALI,
    terms=(("friction", lambda m, p: p.force * direction(m, p)),),
    parameters=(EffectParameter("force", "N", 0.0, 100.0, 0.0, 2e3, "F_c; 20 to 400 N"), _velocity()),
    looks_like="A constant share of the pressure is lost, so that low supply pressures suffer most.",
    confused_with=("stribeck_friction", "constant_load"),
)


def _stribeck(m: Scope, p: Own) -> Scalar:
    share = exp(-((m.velocity / p.stribeck_velocity) ** 2))
    return (p.force + (p.static_force - p.force) * share) * direction(m, p)


STRIBECK_FRICTION = Effect(
    name="stribeck_friction",
    family=_FAMILY,
    summary="The seals drag most at the start and less when they slide.",
    equation="F = (F_c + (F_s − F_c)·exp(−(v/v_st)²))·tanh(v/v_s)",
    source=_JELALI,
    terms=(("friction", _stribeck),),
    parameters=(
        EffectParameter("force", "N", 0.0, 80.0, 0.0, 2e3, "F_c while sliding"),
        EffectParameter("static_force", "N", 0.0, 200.0, 0.0, 4e3, "F_s at the start"),
        EffectParameter(
            "stribeck_velocity",
            "mm/s",
            None,
            10e-3,
            1e-3,
            0.2,
            "v_st, where the drag has fallen",
            grid=(3e-3, 40e-3),
        ),
        _velocity(),
    ),
    looks_like="As Coulomb friction, with a jerk at the start; shows at slow speeds only.",
    confused_with=("coulomb_friction", "pressure_friction"),
    needs="slow motion",
)


def _seal_force(m: Scope, p: Own) -> Scalar:
    pressed = positive_part(m.pressure_a, _SEAL_WIDTH) + positive_part(m.pressure_b, _SEAL_WIDTH)
    return p.area * pressed * direction(m, p)


PRESSURE_FRICTION = Effect(
    name="pressure_friction",
    family=_FAMILY,
    summary="The seals are pressed against the bore by the chambers' pressures.",
    equation="F = k·(p_A + p_B)·tanh(v/v_s)",
    source=_JELALI + "; seal makers' data",
    terms=(("friction", _seal_force),),
    parameters=(
        EffectParameter("area", "mm^2", 0.0, 20e-6, 0.0, 500e-6, "k, friction per pressure"),
        _velocity(),
    ),
    looks_like="Friction that grows with the supply pressure.",
    confused_with=("coulomb_friction", "stribeck_friction"),
    needs="chamber pressures",
)

EFFECTS = (VISCOUS_FRICTION, COULOMB_FRICTION, STRIBECK_FRICTION, PRESSURE_FRICTION)
