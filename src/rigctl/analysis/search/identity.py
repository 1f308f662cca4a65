"""How far an answer goes: where something is missing, on which variables it depends, and by which law.

A level is claimed only if every effect that these data allow agrees on it. Two effects at one slot with the
same explanatory variables are laws of one answer: Coulomb and Stribeck friction, leakage through a gap and
through an orifice.

What is missing need not be in the library, so the remainder counts too: a law that leaves anything is not the
right law; a constant that leaves anything may not be one; a term that the data require to be constant does
not depend on the variables of its effect; several effects that leave something may together only resemble
what is missing, but for one that would be certain alone (`rigctl.analysis.search.certainty`); and the law of
an effect that needs an unusual size may be another.
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
    place: its slots; `place_sure` if every effect that cannot be distinguished from it acts there.
    driver: the states and inputs on which it depends; `driver_sure` if all of these depend on the same ones.
    law_sure: whether it is distinguished from all others, and the data require all of it and no other shape.
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


def certain_members(levels: Sequence[Levels]) -> tuple[str, ...]:
    """The effects of an answer of which at least the location is certain."""
    return tuple(one.effect for one in levels if one.place_sure)


def same_cause(one: Effect, other: Effect) -> bool:
    """Whether two effects are laws of one answer: at the same slots, over the same variables."""
    return set(one.slots) == set(other.slots) and driver_variables(one) == driver_variables(other)


def wanted_elsewhere(effects: Sequence[Effect], slot: str) -> bool:
    """Whether several effects leave something at a slot where none of them acts."""
    return len(effects) > 1 and slot != "" and not any(slot in effect.slots for effect in effects)


def only_constants(effects: Sequence[Effect]) -> bool:
    """Whether there are several effects, and none has an explanatory variable."""
    return len(effects) > 1 and not any(driver_variables(effect) for effect in effects)


def levels_of(
    classes: Sequence[Sequence[str]],
    effects: Mapping[str, Effect],
    *,
    sure: bool,
    other_shape: bool,
    usual: bool = True,
    spare: Collection[str] = (),
    complete: bool = True,
    constant: Mapping[str, Collection[str]] = MappingProxyType({}),
    steady: Collection[str] = (),
    varying: Collection[str] = (),
) -> tuple[Levels, ...]:
    """The levels of each member of an answer.

    Parameters
    ----------
    classes: for each member, itself and the effects that are not distinguished from it.
    effects: all of these by name.
    sure: whether any level may be claimed: the set's remainder and its predictions show that it is right.
    other_shape: whether the data require another shape of the law of any member.
    usual: no parameter is outside its usual range, which speaks against a law.
    spare: members that a simpler law, a limiting case of theirs, could replace.
    complete: the data show nothing more.
    constant: for members, the variables on which, by the data, their terms do not depend.
    steady: members without explanatory variables that leave no more than their scatter between records.
    varying: members without explanatory variables whose sizes follow the operating point.
    """
    levels = []
    for names in classes:
        first, *others = (effects[name] for name in names)
        same_slots = all(set(first.slots) == set(other.slots) for other in others)
        variables = driver_variables(first)
        driver = same_slots and all(variables == driver_variables(other) for other in others)
        levels.append(
            Levels(
                effect=first.name,
                place=first.slots,
                driver=tuple(sorted(variables)),
                place_sure=sure and same_slots,
                driver_sure=sure
                and driver
                and not constant.get(first.name)
                and (complete or bool(variables) or first.name in steady)
                and first.name not in varying,
                law_sure=sure
                and usual
                and complete
                and not others
                and not other_shape
                and first.name not in spare,
            )
        )
    return tuple(levels)
