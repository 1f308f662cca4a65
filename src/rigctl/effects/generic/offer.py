"""Which generic effects a family gets at each of its slots."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import dataclass, replace
from threading import Lock

from rigctl.effects.declaration import Effect
from rigctl.effects.generic.balance import at_balance
from rigctl.effects.generic.given import at_input, at_switches
from rigctl.effects.generic.magnitudes import Magnitudes
from rigctl.effects.generic.places import (
    Balance,
    Given,
    Late,
    Nowhere,
    Place,
    Reading,
    is_point_on_scale,
    places,
)
from rigctl.effects.generic.reading import at_reading
from rigctl.physics.family import ModelFamily

#: families whose effects are remembered
_KEPT = 16
_made: OrderedDict[int, tuple[ModelFamily, tuple[Offer, ...]]] = OrderedDict()
_making = Lock()


@dataclass(frozen=True)
class Offer:
    """What is offered at a slot, and why other effects are not."""

    place: Place
    effects: tuple[Effect, ...]
    why_not: str = ""


def generic_effects(family: ModelFamily) -> tuple[Effect, ...]:
    """The generic effects of a family, slot after slot; none for one that has a library of its own.

    Raises
    ------
    RigctlError
        an equation of the family has the wrong dimension.
    """
    return tuple(effect for offer in offers(family) for effect in offer.effects)


def offers(family: ModelFamily) -> tuple[Offer, ...]:
    """What is offered at every slot of a family; empty for one that has a library of its own.

    Raises
    ------
    RigctlError
        an equation of the family has the wrong dimension.
    """
    if not family.generic or not family.slots:
        return ()
    with _making:
        known = _made.get(id(family))
        if known is None or known[0] is not family:
            # two parses of one file are two families: each has effects whose terms name its own slots
            known = (family, tuple(_offers(family)))
            _made[id(family)] = known
            while len(_made) > _KEPT:
                _made.popitem(last=False)
    return known[1]


def _offers(family: ModelFamily) -> Iterator[Offer]:
    sizes = Magnitudes(family)
    found = [(place, tuple(_at(family, place, sizes))) for place in places(family)]
    names = {effect.name for _, effects in found for effect in effects}
    taken: set[str] = set()
    for place, effects in found:
        unique = []
        for effect in effects:
            if effect.name not in taken:
                taken.add(effect.name)
                known = tuple(name for name in effect.confused_with if name in names)
                unique.append(replace(effect, confused_with=known))
        yield Offer(place, tuple(unique), _why_not(place))


def _at(family: ModelFamily, place: Place, sizes: Magnitudes) -> Iterator[Effect]:
    match place:
        case Balance():
            yield from at_balance(family, place, sizes)
        case Reading():
            yield from at_reading(family, place, sizes)
        case Given():
            yield from at_input(family, place, sizes)
        case Late():
            yield from at_switches(family, place, sizes)
        case Nowhere():
            return


def _why_not(place: Place) -> str:
    match place:
        case Nowhere():
            return place.why
        case Balance(moves=True):
            return "no leak, power law, threshold or second store: it is a speed, which nothing stores"
        case Balance():
            return "no friction: it is no speed"
        case Reading() if not place.slopes and not place.inputs:
            return "no gain, lag, saturation or hysteresis: it reads no state"
        case Given():
            return _why_not_of_input(place)
        case _:
            return ""


def _why_not_of_input(place: Given) -> str:
    if place.surroundings:
        return "an offset alone: it is not commanded"
    return "no saturation or dead band: 0 K is no rest" if is_point_on_scale(place.input) else ""
