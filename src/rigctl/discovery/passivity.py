"""Does a term dissipate energy, as friction and leaks do, or supply it?

In the balance of a state s the power of a term is ``direction·w·s``, s measured from its surroundings:
negative power is dissipated. A term that does not depend on s has no definite sign: a spring returns what it
has taken.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.linear.shape_tolerance import courses
from rigctl.discovery.formulas import Formula
from rigctl.discovery.open_slots import OpenSlots
from rigctl.effects.drivers import Driver
from rigctl.effects.generic.slot_roles import Balance, slot_roles
from rigctl.errors import RigctlError

Floats = NDArray[np.float64]

#: share of power with the opposite sign that is attributed to rounding and noise
_SMALL = 0.02


def passivity(formula: Formula, opened: OpenSlots) -> str:
    """``dissipates energy``, ``supplies energy``, ``both supplies and dissipates energy``; "" if unknown."""
    family = opened.problem.model.family
    try:
        place = next((one for one in slot_roles(family) if one.slot.name == formula.slot.name), None)
    except RigctlError:
        return ""
    if not isinstance(place, Balance):
        return ""
    if all(place.state.name not in one.argument.driver.variables for one in formula.factors):
        return ""
    value = np.full(opened.values(Driver(((place.state.name, 1.0),), place.state.unit)).shape, formula.size)
    for one in formula.factors:
        value = value * one.of(opened.values(one.argument.driver))
    power = place.direction * value * _above(place, opened)
    lost, gained = float(-power[power < 0.0].sum()), float(power[power > 0.0].sum())
    if not lost + gained > 0.0:
        return ""
    if gained <= _SMALL * lost:
        return "dissipates energy"
    return "supplies energy" if lost <= _SMALL * gained else "both supplies and dissipates energy"


def _above(place: Balance, opened: OpenSlots) -> Floats:
    name, moving = place.surroundings, [(place.state.name, 1.0)]
    model = opened.problem.model
    given = {one.name: model.values.get(one.name, one.value) for one in model.family.parameters}
    level = place.reference if name is None else given.get(name, 0.0)
    if name is not None and name not in given:
        moving.append((name, -1.0))
    along = courses(opened.problem, opened.trajectories, Driver(tuple(moving), place.state.unit))
    return np.asarray(np.concatenate(along) - level)
