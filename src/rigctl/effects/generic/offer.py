"""Which generic effects a family gets at each of its slots."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import dataclass, replace
from threading import Lock

from rigctl.effects.declaration import Effect
from rigctl.effects.generic.actuator import at_input, at_switches
from rigctl.effects.generic.balance import at_balance
from rigctl.effects.generic.magnitudes import Magnitudes
from rigctl.effects.generic.parameter import at_parameter
from rigctl.effects.generic.sensor import at_reading
from rigctl.effects.generic.slot_roles import (
    Balance,
    Given,
    Late,
    OfProgram,
    Reading,
    Role,
    UnusableSlot,
    is_point_on_scale,
    slot_roles,
)
from rigctl.physics.family import ModelFamily

#: number of families whose effects are cached
_KEPT = 16
_offered: OrderedDict[int, tuple[ModelFamily, tuple[Offer, ...]]] = OrderedDict()
_making = Lock()


@dataclass(frozen=True)
class Offer:
    """The effects offered at a slot, and why others are not."""

    role: Role
    effects: tuple[Effect, ...]
    why_not: str = ""


def generic_effects(family: ModelFamily) -> tuple[Effect, ...]:
    """The generic effects of a family, slot by slot; none for a family with its own library.

    Raises
    ------
    RigctlError
        an equation of the family has the wrong dimension.
    """
    return tuple(effect for offer in offers(family) for effect in offer.effects)


def offers(family: ModelFamily) -> tuple[Offer, ...]:
    """The effects offered at every slot of a family; empty for a family with its own library.

    Raises
    ------
    RigctlError
        an equation of the family has the wrong dimension.
    """
    if not family.generic or not family.slots:
        return ()
    with _making:
        known = _offered.get(id(family))
        if known is None or known[0] is not family:
            # two parses of one file are two families: the terms of each refer to its own slots
            known = (family, tuple(_offers(family)))
            _offered[id(family)] = known
            while len(_offered) > _KEPT:
                _offered.popitem(last=False)
    return known[1]


def _offers(family: ModelFamily) -> Iterator[Offer]:
    # Should two slots give effects of one name, the first in the family's order keeps it. Rivals that the
    # family does not get are dropped, so that an answer never names an effect that does not exist.
    sizes = Magnitudes(family)
    effects_by_role = [(role, tuple(_at(family, role, sizes))) for role in slot_roles(family)]
    names = {effect.name for _, effects in effects_by_role for effect in effects}
    taken: set[str] = set()
    for role, effects in effects_by_role:
        unique = []
        for effect in effects:
            if effect.name not in taken:
                taken.add(effect.name)
                known = tuple(name for name in effect.confused_with if name in names)
                unique.append(replace(effect, confused_with=known))
        yield Offer(role, tuple(unique), _why_not(role))


def _at(family: ModelFamily, role: Role, sizes: Magnitudes) -> Iterator[Effect]:
    match role:
        case Balance():
            yield from at_balance(family, role, sizes)
        case Reading():
            yield from at_reading(family, role, sizes)
        case Given():
            yield from at_input(family, role, sizes)
        case Late():
            yield from at_switches(family, role, sizes)
        case OfProgram():
            yield from at_parameter(family, role, sizes)
        case UnusableSlot():
            return


def _why_not(role: Role) -> str:
    match role:
        case UnusableSlot():
            return role.why
        case Balance(moves=True):
            return "no leak, power law, threshold or second store: it is a speed, not a stored quantity"
        case Balance():
            return "no friction: it is not a speed"
        case Reading() if not role.slopes and not role.inputs:
            return "no gain, lag, saturation or hysteresis: it reads no state"
        case Given():
            return _why_not_of_input(role)
        case _:
            fixed = isinstance(role, OfProgram) and not role.tunable
            return "no drift in time: it cannot change during a simulation" if fixed else ""


def _why_not_of_input(role: Given) -> str:
    if role.surroundings:
        return "only an offset: it is not commanded"
    return "no saturation or dead band: 0 K is not a neutral value" if is_point_on_scale(role.input) else ""
