"""Friction of the seals and of the oil film.

The force of a seal does not reverse immediately with the direction of motion: its lip first bends by a few
hundredths of a millimetre, and while it is bent the piston sticks and a pressure difference between the
chambers persists. Dahl's state z is the deflection, −1 to 1, with ``dz/dt = (v − |v|·z)/s``; at ±1 the lip
slides. Every law of dry friction here is a size times that z, so that none has a discontinuity at rest.
"""

from __future__ import annotations

from rigctl.effects.declaration import Effect, EffectParameter, EffectState, Own
from rigctl.engine.symbols import Scalar, constant_like, exp, positive_part, tanh
from rigctl.physics.scope import Scope

_FAMILY = "hydraulic_cylinder"
_JELALI = "Jelali & Kroll, Hydraulic Servo-systems (2003), section 3.4"

#: chamber pressure within which the contact force of a seal is rounded to zero, in Pa
_SEAL_WIDTH = 1e4


#: speed below which a lip keeps its deflection, in m/s
_REST = 1e-5


def _presliding() -> EffectParameter:
    return EffectParameter(
        "presliding",
        "mm",
        None,
        20e-6,
        1e-6,
        1e-3,
        "s, how far the seal's lip bends before it slides",
        grid=(5e-6, 100e-6),
        physical="none",
    )


def _bending_rate(m: Scope, p: Own) -> Scalar:
    # v| with a corner at rest that has a derivative: v·tanh(v/v₀).
    speed = m.velocity * tanh(m.velocity / constant_like(_REST, m.velocity))
    return (m.velocity - speed * p.bending) / p.presliding


def _bending() -> EffectState:
    """The deflection z of the lip; records are assumed to start after a retraction."""
    return EffectState("bending", "1", 0.1, _bending_rate, "z, of the seal's lip", start=-1.0)


VISCOUS_FRICTION = Effect(
    name="viscous_friction",
    family=_FAMILY,
    summary="The oil film drags in proportion to speed and viscosity.",
    equation="F = k·µ·v",
    source=_JELALI + "; a film of area A and thickness h has k = A/h",
    terms=(("friction", lambda m, p: p.coefficient * m.viscosity * m.velocity),),
    parameters=(
        EffectParameter(
            "coefficient", "m", 0.0, 500.0, 0.0, 2e4, "k; 240 (20 um film) to 2500 m", physical="low"
        ),
    ),
    looks_like="Slower in cold oil, in proportion to speed.",
    confused_with=("laminar_throttle", "line_loss"),
    needs="records at several oil temperatures",
)

COULOMB_FRICTION = Effect(
    name="coulomb_friction",
    family=_FAMILY,
    summary="The seals drag with a constant force against the motion.",
    equation="F = F_c·z, dz/dt = (v − |v|·z)/s",
    source=_JELALI,
    terms=(("friction", lambda m, p: p.force * p.bending),),
    parameters=(
        EffectParameter("force", "N", 0.0, 100.0, 0.0, 2e3, "F_c; 20 to 400 N", physical="low"),
        _presliding(),
    ),
    states=(_bending(),),
    looks_like="A constant share of the pressure is lost, so that low supply pressures suffer most.",
    confused_with=("stribeck_friction", "constant_load"),
)


def _stribeck(m: Scope, p: Own) -> Scalar:
    share = exp(-((m.velocity / p.stribeck_velocity) ** 2))
    return (p.force + (p.static_force - p.force) * share) * p.bending


STRIBECK_FRICTION = Effect(
    name="stribeck_friction",
    family=_FAMILY,
    summary="The seals drag most at the start and less when they slide.",
    equation="F = (F_c + (F_s − F_c)·exp(−(v/v_st)²))·z, dz/dt = (v − |v|·z)/s",
    source=_JELALI,
    terms=(("friction", _stribeck),),
    parameters=(
        EffectParameter("force", "N", 0.0, 80.0, 0.0, 2e3, "F_c while sliding", physical="low"),
        EffectParameter(
            "static_force",
            "N",
            0.0,
            200.0,
            0.0,
            4e3,
            "F_s at the start",
            physical="low",
            at_least="force",
        ),
        EffectParameter(
            "stribeck_velocity",
            "mm/s",
            None,
            10e-3,
            1e-3,
            0.2,
            "v_st, where the drag has fallen",
            grid=(3e-3, 40e-3),
            physical="none",
        ),
        _presliding(),
    ),
    states=(_bending(),),
    looks_like="As Coulomb friction, with a jerk at the start; shows at slow speeds only.",
    confused_with=("coulomb_friction", "pressure_friction"),
    becomes=(("static_force", "force", "coulomb_friction"),),
    needs="slow motion",
)


def _seal_force(m: Scope, p: Own) -> Scalar:
    pressed = positive_part(m.pressure_a, _SEAL_WIDTH) + positive_part(m.pressure_b, _SEAL_WIDTH)
    return p.area * pressed * p.bending


PRESSURE_FRICTION = Effect(
    name="pressure_friction",
    family=_FAMILY,
    summary="The seals are pressed against the bore by the chambers' pressures.",
    equation="F = k·(p_A + p_B)·z, dz/dt = (v − |v|·z)/s",
    source=_JELALI + "; seal makers' data",
    terms=(("friction", _seal_force),),
    parameters=(
        EffectParameter("area", "mm^2", 0.0, 20e-6, 0.0, 500e-6, "k, friction per pressure", physical="low"),
        _presliding(),
    ),
    states=(_bending(),),
    looks_like="Friction that grows with the supply pressure.",
    confused_with=("coulomb_friction", "stribeck_friction"),
    needs="chamber pressures",
)

EFFECTS = (VISCOUS_FRICTION, COULOMB_FRICTION, STRIBECK_FRICTION, PRESSURE_FRICTION)
