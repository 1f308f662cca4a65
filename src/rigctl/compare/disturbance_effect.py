"""An unknown disturbance at the slots of a family, declared like an effect with its amplitudes at null.

At a slot of the process or of a command it is ``w(t) = Σ_k a_k·Λ(t/h − k)``, tents Λ at K knots that are h
apart. At a slot of which only the readings depend it is a level: no motion follows, so that one derivative
says what any course of it does.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache, partial

from rigctl.effects.declaration import Effect, EffectParameter, EffectState, Own, qualified
from rigctl.engine.symbols import Scalar, positive_part
from rigctl.engine.system import System
from rigctl.model.build import build_system
from rigctl.model.fit.problem import Problem
from rigctl.physics.family import ModelFamily, Slot
from rigctl.physics.scope import Scope

#: what the hidden effect is called
DISTURBANCE = "disturbance"
#: its parameter that sets the time between two knots, s
SPACING = qualified(DISTURBANCE, "spacing")
#: how sharp a tent's corners are, in knots
_CORNER = 1e-3
#: amplitudes stay at their null, so that bounds do not matter
_BOUND = 1e12


def amplitude(slot: Slot, knot: int) -> str:
    """The parameter of a slot's disturbance at a knot, as a system knows it."""
    return qualified(DISTURBANCE, f"{slot.name}_{knot}")


def level(slot: Slot) -> str:
    """The parameter of a slot's disturbance that does not change."""
    return qualified(DISTURBANCE, f"{slot.name}_level")


def disturbed_system(problem: Problem, moving: Sequence[Slot], reading: Sequence[Slot], knots: int) -> System:
    """The model of `problem` with tents at the slots `moving` and levels at the slots `reading`.

    Raises
    ------
    RigctlError
        a slot takes no term.
    """
    model, level_effect = problem.model, problem.level.effect
    effect = _effect(model.family, moving, reading, knots)
    effects = {name: {p: value.si for p, value in own.items()} for name, own in model.effects.items()}
    return build_system(
        model.family,
        {**effects, **problem.level.null, DISTURBANCE: effect.null},
        problem.measurements.rig or model.rig,
        parameters={name: value for name, value in model.values.items() if "." not in name},
        oil=model.oil,
        own=(*model.own, *((level_effect,) if level_effect is not None else ()), effect),
    )


def sort_slots(problem: Problem) -> tuple[tuple[Slot, ...], tuple[Slot, ...]]:
    """The slots of which a state or a switch time depends, and those of which only measured readings do."""
    slots = problem.model.family.slots
    system = disturbed_system(problem, (), slots, 0)
    measured = set(problem.measurements.outputs)
    moved = [*system.rhs, *(delay.expr for delay in system.delays)]
    read = [output.expr for output in system.outputs if output.name in measured]
    moving, reading = [], []
    for slot in slots:
        variable = system.graph.variables.get(level(slot))
        if variable is None:
            continue
        if any(expr.depends_on & variable.depends_on for expr in moved):
            moving.append(slot)
        elif any(expr.depends_on & variable.depends_on for expr in read):
            reading.append(slot)
    return tuple(moving), tuple(reading)


def _effect(family: ModelFamily, moving: Sequence[Slot], reading: Sequence[Slot], knots: int) -> Effect:
    tents = [(slot.name, partial(_tents, slot, knots)) for slot in moving]
    levels = [(slot.name, partial(_level, slot)) for slot in reading]
    names = [(f"{slot.name}_{k}", slot.unit) for slot in moving for k in range(knots)]
    names += [(f"{slot.name}_level", slot.unit) for slot in reading]
    return Effect(
        name=DISTURBANCE,
        family=family.name,
        own_family=family,
        summary="What a record says of an unknown term.",
        equation="w(t) = sum of a_k * tent(t/h - k)",
        source="Kristensen, Madsen & Jorgensen, Automatica 40 (2004) 225",
        looks_like="Anything.",
        terms=(*tents, *levels),
        parameters=(
            *(EffectParameter(name, unit, 0.0, 1.0, -_BOUND, _BOUND, "amplitude") for name, unit in names),
            EffectParameter("spacing", "s", None, 1.0, 0.0, _BOUND, "h, from knot to knot"),
        ),
        states=(EffectState("clock", "s", 1.0, lambda m, p: 1.0, "time since the record began"),),
    )


def _tents(slot: Slot, knots: int, _: Scope, p: Own) -> Scalar:
    total: Scalar = 0.0
    for k, tent in enumerate(_shapes(p.clock / p.spacing, knots)):
        total = total + p[f"{slot.name}_{k}"] * tent
    return 1.0 + total if slot.combine == "product" else total


@lru_cache(maxsize=1)
def _shapes(place: Scalar, knots: int) -> tuple[Scalar, ...]:
    """Tents at 0, 1, … of ``place``, each a second difference of ramps; every slot has the same."""
    ramps = [positive_part(place - float(k), _CORNER) for k in range(-1, knots + 1)]
    return tuple(ramps[k] - 2.0 * ramps[k + 1] + ramps[k + 2] for k in range(knots))


def _level(slot: Slot, _: Scope, p: Own) -> Scalar:
    value = p[f"{slot.name}_level"]
    return 1.0 + value if slot.combine == "product" else value
