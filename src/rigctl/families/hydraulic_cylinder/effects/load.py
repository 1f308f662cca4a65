"""Loads on the rod."""

from __future__ import annotations

from rigctl.effects.declaration import Effect, EffectParameter

_FAMILY = "hydraulic_cylinder"
_NEWTON = "Newton's second law; Merritt (1967), section 6-1"

LOAD_MASS = Effect(
    name="load_mass",
    family=_FAMILY,
    summary="The moving mass is larger than in the model.",
    equation="(m + m_L)·dv/dt = ΣF",
    source=_NEWTON,
    terms=(("mass", lambda m, p: p.mass),),
    parameters=(EffectParameter("mass", "kg", 0.0, 20.0, 0.0, 2e3, "m_L", physical="low"),),
    looks_like="Slower oscillation of speed and chamber pressures at each switch.",
    confused_with=("entrained_air", "hose_compliance"),
    needs="chamber pressures or fast sampling; a fitted moving mass hides it",
)

SPRING_LOAD = Effect(
    name="spring_load",
    family=_FAMILY,
    summary="The rod pushes against a spring.",
    equation="F = c·x",
    source=_NEWTON,
    terms=(("load", lambda m, p: p.stiffness * m.position),),
    parameters=(EffectParameter("stiffness", "N/m", 0.0, 2e3, 0.0, 1e6, "c", physical="low"),),
    looks_like="Extension slows down along the stroke; chamber pressures rise with position.",
    confused_with=("constant_load", "piston_leakage"),
)

CONSTANT_LOAD = Effect(
    name="constant_load",
    family=_FAMILY,
    summary="A constant force acts on the rod, for instance a weight.",
    equation="F = F_0, against extension",
    source=_NEWTON,
    terms=(("load", lambda m, p: p.force),),
    parameters=(
        EffectParameter(
            "force", "N", 0.0, 200.0, -1e4, 1e4, "F_0; negative pulls the rod out", physical="none"
        ),
    ),
    looks_like="Extension slower and retraction faster, or the other way round.",
    confused_with=("coulomb_friction", "spring_load"),
)

EFFECTS = (LOAD_MASS, SPRING_LOAD, CONSTANT_LOAD)
