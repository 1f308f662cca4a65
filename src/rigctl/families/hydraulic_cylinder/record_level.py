"""Record-level unknowns of the cylinder: the relief valve's setting, zeros, initial states."""

from __future__ import annotations

import math
from collections.abc import Mapping

from rigctl.effects.declaration import Effect, EffectParameter
from rigctl.effects.record_level import RECORD, Quantity, RecordLevel, Setting, Start
from rigctl.families.hydraulic_cylinder.piston import CONTACT_WIDTH
from rigctl.rig.rig import Rig

#: relative repeatability of a relief valve's setting, by default
_REPEATABILITY = 0.005
#: standard deviation of a position sensor's zero if the rig does not state it, in m
_ZERO = 0.1e-3
#: lowest pressure assumed to hold the piston against its stop, in Pa
_TRAPPED = 1e3


def _repeatability(rig: Rig | None) -> float:
    role = rig.roles.set_pressure if rig is not None else None
    actuator = rig.actuators[role.actuator] if rig is not None and role is not None else None
    repeatability = actuator.repeatability if actuator is not None else None
    return _REPEATABILITY if repeatability is None else repeatability


def _zero(rig: Rig | None) -> float:
    channel = rig.channels.get("position") if rig is not None else None
    uncertainty = 0.0 if channel is None else channel.uncertainty
    return 0.5 * uncertainty or _ZERO  # stated at 95 %, about two standard deviations


def _on_the_stop(states: Mapping[str, float], parameters: Mapping[str, float]) -> float:
    """Initial position, in m, at which the trapped oil holds the piston against its end stop.

    The force of the stop at a depth d is ``k·(d + sqrt(d² + w²))/2``; it balances ``A_B·p_B`` at
    ``x = −d = (w² − 4s²)/(4s)``, s = A_B·p_B/k.
    """
    area = 0.25 * math.pi * (parameters["bore"] ** 2 - parameters["rod"] ** 2)
    depth = area * max(states["pressure_b"], _TRAPPED) / parameters["end_stop_stiffness"]
    return (CONTACT_WIDTH**2 - 4.0 * depth**2) / (4.0 * depth)


_EFFECT = Effect(
    name=RECORD,
    family="hydraulic_cylinder",
    summary="Quantities that differ from record to record.",
    equation="p_set·(1 + e), x_read = x + z",
    source="repeated measurements at one condition",
    looks_like="Records of one condition differ.",
    terms=(
        ("relief_setting", lambda m, p: 1.0 + p.setting),
        ("position_reading", lambda m, p: p.position_zero),
    ),
    parameters=(
        EffectParameter("setting", "%", 0.0, 1e-3, -0.3, 0.3, "e, error of the relief valve's setting"),
        EffectParameter("position_zero", "mm", 0.0, 1e-4, -0.05, 0.05, "z, zero of the position sensor"),
    ),
)

RECORD_LEVEL = RecordLevel(
    effect=_EFFECT,
    quantities=(
        Quantity("setting", "error of the pressure setting", _repeatability),
        Quantity("position_zero", "zero of the position sensor", _zero, cancels=True),
    ),
    starts=(
        Start("oil_temperature", "measured"),
        Start("supply_pressure", "set", input="pressure_setpoint"),
        Start("pressure_a", "set", input="pressure_setpoint", share=0.0, spread=0.2),
        Start("pressure_b", "set", input="pressure_setpoint", share=0.9, spread=0.2),
        Start("position", "rest", rest=1e-3, at_rest=_on_the_stop),
    ),
    setting=Setting("pressure_setpoint", "relief_setting", _repeatability),
)
