"""Effects by name: the library's own, and those registered by installed packages.

A package offers its effects under the entry point group ``rigctl.effects``; each entry is an `Effect`, the
path of an effect file or of a folder of them, or a sequence of these.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextvars import ContextVar
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType

from rigctl.argument_types import checks_argument_types
from rigctl.effects.declaration import Effect, problems
from rigctl.effects.examine import examine
from rigctl.effects.generic import generic_effects
from rigctl.errors import RigctlError, unknown_name
from rigctl.physics.families import find_family, of_shipped
from rigctl.physics.family import ModelFamily

ENTRY_POINTS = "rigctl.effects"

#: True while effects of packages are read: a package's file may only refer to shipped effects, or to effects
#: in the same folder
_reading_packages: ContextVar[bool] = ContextVar("reading the effects of packages", default=False)


@lru_cache(maxsize=1)
def _shipped() -> tuple[Effect, ...]:
    return tuple(effect for effects in of_shipped("effects", "EFFECTS").values() for effect in effects)


@lru_cache(maxsize=1)
def installed_effects() -> tuple[Effect, ...]:
    """The effects registered by installed packages, for all families; read once.

    Raises
    ------
    RigctlError
        a package cannot be loaded, or registers an invalid effect.
    """
    from importlib.metadata import entry_points

    token = _reading_packages.set(True)
    try:
        return tuple(
            effect for point in entry_points(group=ENTRY_POINTS) for effect in _load(point.name, point.load)
        )
    finally:
        _reading_packages.reset(token)


def shipped_effects(family: str) -> tuple[Effect, ...]:
    """The library's own effects of a family, without those of installed packages."""
    return tuple(effect for effect in _shipped() if effect.family == family)


def library(family: str | ModelFamily) -> Mapping[str, Effect]:
    """The effects of a model family, by name, in the library's order: its own, then the generic ones.

    Raises
    ------
    RigctlError
        there is no such family, an installed package registers an invalid effect, or a name is already taken.
    """
    effects: dict[str, Effect] = {}
    chosen = find_family(family) if isinstance(family, str) else family
    name = chosen.name
    # While a package's effect files are read, they ask for this library in order to check the names they
    # mention: installed effects are then left out, or reading them would need themselves.
    installed = () if _reading_packages.get() else installed_effects()
    for effect in (*_shipped(), *installed):
        if effect.family == name:
            if effect.name in effects:
                raise RigctlError("two effects have the same name", value=effect.name)
            effects[effect.name] = effect
    for effect in generic_effects(chosen):
        effects.setdefault(effect.name, effect)  # one that was written for the family takes precedence
    return MappingProxyType(effects)


@checks_argument_types
def find_effect(name: str, family: str | ModelFamily) -> Effect:
    """The effect called `name`.

    Raises
    ------
    RigctlError
            there is none; the message gives the nearest name.
    """
    known = library(family)
    if name not in known:
        raise unknown_name("effect", name, known)
    return known[name]


def check_effect(effect: Effect) -> Effect:
    """The effect itself, if its declaration is valid and its terms behave as declared.

    Raises
    ------
    RigctlError
        they do not; the message lists everything that is wrong.
    """
    family = effect.model_family
    faults = problems(effect, family)
    if not faults and effect.terms:
        faults = [f"{name}: {error}" for (_, name), error in examine(effect, family)]
    if faults:
        raise RigctlError(f"the effect {effect.name} is not sound: {'; '.join(faults)}")
    return effect


def _load(name: str, load: Callable[[], object]) -> Iterator[Effect]:
    try:
        loaded = load()
    except Exception as problem:  # a foreign package may fail in any way
        raise RigctlError(f"the effects registered as {name!r} cannot be loaded: {problem}") from problem
    items: Iterable[object] = loaded if isinstance(loaded, list | tuple) else (loaded,)
    for item in items:
        if isinstance(item, Path):
            yield from _of_files(name, item)
        elif isinstance(item, Effect):
            yield check_effect(item)
        else:
            raise RigctlError(f"what is registered as {name!r} is no effect", value=repr(item))


def _of_files(name: str, path: Path) -> Iterator[Effect]:
    """The effects of a package's file, or of the files in its folder."""
    from rigctl.effects.user.load import effect_files, load_effect

    files = effect_files(path) if path.is_dir() else [path]
    if not files:
        raise RigctlError(f"the folder registered as {name!r} has no effect files", value=path.as_posix())
    for file in files:
        yield load_effect(file)
