"""Errors of the viscometer and its thermometer."""

from __future__ import annotations

from rigctl.effects.declaration import Effect, EffectParameter, Own
from rigctl.engine.symbols import Scalar, sqrt
from rigctl.physics.scope import Scope

_FAMILY = "oil_viscosity"


def _end_loss(m: Scope, p: Own) -> Scalar:
    # ν_read − ν = e/ν_read is quadratic in the reading; this is its positive root less ν, in the form that
    # does not cancel for thick oil, where the correction is small.
    true = m.true_kinematic_viscosity
    return 2.0 * p.correction / (true + sqrt(true * true + 4.0 * p.correction))


CAPILLARY_END_CORRECTION = Effect(
    name="capillary_end_correction",
    family=_FAMILY,
    summary="End losses of the capillary make thin oil read too thick.",
    equation="ν = k·t − c/t, read as k·t: ν_read = ν + e/ν_read, e = c·k",
    source="Hagenbach-Couette; ISO 3104, ISO 3105",
    terms=(("kinematic_viscosity_reading", _end_loss),),
    parameters=(
        EffectParameter(
            "correction",
            "cSt^2",
            0.0,
            1e-12,
            0.0,
            2e-10,
            "e = c·k: 1 cSt² adds 1 % at 10 cSt",
            physical="low",
        ),
    ),
    kind="sensor",
    looks_like="Hot, thin oil reads too thick; cold oil does not.",
    confused_with=("walther", "thermometer_offset"),
    needs="thin oil, below 15 cSt",
)

THERMOMETER_OFFSET = Effect(
    name="thermometer_offset",
    family=_FAMILY,
    summary="The bath is not at the temperature that was noted.",
    equation="T = T_read + c",
    source="JCGM 200 (VIM): measurement error of an indicating instrument",
    terms=(("temperature", lambda m, p: p.offset),),
    parameters=(
        EffectParameter("offset", "K", 0.0, 0.5, -10.0, 10.0, "c", difference=True, physical="none"),
    ),
    kind="sensor",
    looks_like="Cold oil reads too thin or too thick, hot oil less so.",
    confused_with=("walther", "capillary_end_correction"),
    needs="an independent viscosity; fitted Vogel constants hide it entirely",
)

EFFECTS = (CAPILLARY_END_CORRECTION, THERMOMETER_OFFSET)
