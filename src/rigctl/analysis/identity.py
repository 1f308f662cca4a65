"""How far an answer goes: where something is missing, what drives it, and by which law.

A level is claimed only where every effect that these data allow agrees on it. Two effects at one place with
one driver are laws of one answer: dry friction and Stribeck's, a leak through a gap and through an orifice.

What is missing need not be in the library, so what the answer leaves speaks too: a law that leaves anything
is not the law, a constant that leaves anything may be none, a term that the data want constant is not driven
by what its effect says, and several effects beside which something is wanted where none of them acts may only
resemble what is missing.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from rigctl.effects.declaration import Effect
from rigctl.effects.drivers import driver_variables


@dataclass(frozen=True)
class Levels:
    """The three levels of one member of an answer.

    Attributes
    ----------
    effect: the most probable effect.
    place: its slots; `place_sure` where every effect that it is not told from acts there.
    driver: the states and inputs that it depends on; `driver_sure` where all of these depend on the same.
    law_sure: where it is told from all others, and the data ask for all of it and for no other shape.
    """

    effect: str
    place: tuple[str, ...]
    driver: tuple[str, ...]
    place_sure: bool
    driver_sure: bool
    law_sure: bool

    def document(self) -> dict[str, Any]:
        """Its machine-readable form."""
        return {
            "effect": self.effect,
            "place": {"slots": list(self.place), "sure": self.place_sure},
            "driver": {"variables": list(self.driver), "sure": self.driver_sure},
            "law": {"effect": self.effect, "sure": self.law_sure},
        }

    @property
    def statement(self) -> str:
        """What is sure where the law is not, in words; "" where the law is sure, or nothing."""
        if self.law_sure or not self.place_sure:
            return ""
        where = " and ".join(self.place)
        if not self.driver_sure:
            return f"Sure is where: a term at {where}; not what it depends on"
        if not self.driver:
            return f"Sure is where: a constant term at {where}; not its law"
        return (
            f"Sure are the place and what it depends on: a term at {where} over {' and '.join(self.driver)}"
        )


def same_cause(one: Effect, other: Effect) -> bool:
    """Whether two effects are laws of one answer: at the same place, over the same variables."""
    return set(one.slots) == set(other.slots) and driver_variables(one) == driver_variables(other)


def wanted_elsewhere(effects: Sequence[Effect], slot: str) -> bool:
    """Whether several effects leave something at a slot where none of them acts."""
    return len(effects) > 1 and slot != "" and not any(slot in effect.slots for effect in effects)


def levels_of(
    classes: Sequence[Sequence[str]],
    effects: Mapping[str, Effect],
    *,
    sure: bool,
    bent: Mapping[str, bool],
    spare: Collection[str] = (),
    whole: bool = True,
    constant: Mapping[str, Collection[str]] = MappingProxyType({}),
    steady: Collection[str] = (),
    varying: Collection[str] = (),
) -> tuple[Levels, ...]:
    """The levels of each member of an answer.

    Parameters
    ----------
    classes: of each member, itself and the effects that it is not told from.
    effects: all of these by name.
    sure: whether anything is: the set is the right one by what it leaves and by what it predicts.
    bent: of each member, whether the data ask for another shape of its law.
    spare: members in whose place a simpler law, which they hold as a limit, does as well.
    whole: nothing is left that these data show.
    constant: of members, the drivers with which the data want their terms not to change.
    steady: members without a driver that leave no more than their sizes scatter from record to record.
    varying: members without a driver whose sizes follow the operating point.
    """
    levels = []
    for names in classes:
        first, *others = (effects[name] for name in names)
        place = all(set(first.slots) == set(other.slots) for other in others)
        variables = driver_variables(first)
        driver = place and all(variables == driver_variables(other) for other in others)
        levels.append(
            Levels(
                effect=first.name,
                place=first.slots,
                driver=tuple(sorted(variables)),
                place_sure=sure and place,
                driver_sure=sure
                and driver
                and not constant.get(first.name)
                and (whole or bool(variables) or first.name in steady)
                and first.name not in varying,
                law_sure=sure
                and whole
                and not others
                and not bent.get(first.name, False)
                and first.name not in spare,
            )
        )
    return tuple(levels)
