"""Effects by name: the library's own, and those that installed packages register.

A package offers its effects under the entry point group ``rigctl.effects``; each entry is an `Effect` or a
sequence of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import lru_cache
from types import MappingProxyType

from rigctl.effects import heater_board, hydraulic_cylinder, oil_viscosity
from rigctl.effects.declaration import Effect, problems
from rigctl.effects.examine import examine
from rigctl.errors import RigctlError, unknown_name
from rigctl.physics.families import find_family
from rigctl.physics.family import ModelFamily

ENTRY_POINTS = "rigctl.effects"


@lru_cache(maxsize=1)
def _shipped() -> tuple[Effect, ...]:
    return (*hydraulic_cylinder.EFFECTS, *heater_board.EFFECTS, *oil_viscosity.EFFECTS)


@lru_cache(maxsize=1)
def installed_effects() -> tuple[Effect, ...]:
    """The effects that installed packages register, of every family; read once.

    Raises
    ------
    RigctlError
        a package cannot be loaded, or registers something that is no sound effect.
    """
    from importlib.metadata import entry_points

    return tuple(
        effect for point in entry_points(group=ENTRY_POINTS) for effect in _load(point.name, point.load)
    )


def shipped_effects(family: str) -> tuple[Effect, ...]:
    """The library's own effects of a family, without those of installed packages."""
    return tuple(effect for effect in _shipped() if effect.family == family)


def library(family: str | ModelFamily) -> Mapping[str, Effect]:
    """The effects of a model family, by name, in the library's order.

    Raises
    ------
    RigctlError
        there is no such family, or an installed package registers something that is no sound effect, or a
        name that is taken.
    """
    name = (find_family(family) if isinstance(family, str) else family).name
    found: dict[str, Effect] = {}
    for effect in (*_shipped(), *installed_effects()):
        if effect.family == name:
            if effect.name in found:
                raise RigctlError("two effects have the same name", value=effect.name)
            found[effect.name] = effect
    return MappingProxyType(found)


def find_effect(name: str, family: str | ModelFamily) -> Effect:
    """The effect called `name`.

    Raises
    ------
    RigctlError
        there is none; it says the nearest.
    """
    known = library(family)
    if name not in known:
        raise unknown_name("effect", name, known)
    return known[name]


def check_effect(effect: Effect) -> Effect:
    """The effect itself when its declaration is sound, and its terms keep what it promises.

    Raises
    ------
    RigctlError
        they do not; it says everything that is wrong.
    """
    family = effect.model_family
    found = problems(effect, family)
    if not found and effect.terms:
        found = [f"{name}: {error}" for (_, name), error in examine(effect, family)]
    if found:
        raise RigctlError(f"the effect {effect.name} is not sound: {'; '.join(found)}")
    return effect


def _load(name: str, load: Callable[[], object]) -> Iterator[Effect]:
    try:
        loaded = load()
    except Exception as problem:  # a foreign package may fail in any way
        raise RigctlError(f"the effects registered as {name!r} cannot be loaded: {problem}") from problem
    items: Iterable[object] = loaded if isinstance(loaded, list | tuple) else (loaded,)
    for item in items:
        if not isinstance(item, Effect):
            raise RigctlError(f"what is registered as {name!r} is no effect", value=repr(item))
        yield check_effect(item)
