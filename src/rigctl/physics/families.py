"""Model families by name, or by the file that describes one.

A name is looked for among the families that come with rigctl (the folders of `rigctl.families`), among those
given to the command on purpose (`using_families`), and among those that installed packages register under
the entry point group ``rigctl.families``. Naming a YAML file reads it; nothing in it runs. Naming a Python
file does not run it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from rigctl.argument_types import checks_argument_types
from rigctl.errors import RigctlError, unknown_name
from rigctl.physics.derived_slots import with_derived_slots
from rigctl.physics.family import ModelFamily
from rigctl.physics.family_checks import check_family
from rigctl.project import find_project

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

ENTRY_POINTS = "rigctl.families"

#: the package whose folders are the families that come with rigctl
SHIPPED = "rigctl.families"


def of_shipped(module: str, name: str) -> Mapping[str, Any]:
    """The object `name` in the `module` of each shipped family that has this module, by its folder.

    They are looked up like plug-ins: nothing below the families imports one of them.
    """
    shipped = import_module(SHIPPED)
    found = {}
    for folder in dict.fromkeys((*shipped.FIRST, *(item.name for item in iter_modules(shipped.__path__)))):
        package = import_module(f"{SHIPPED}.{folder}")
        if module in {part.name for part in iter_modules(package.__path__)}:
            found[folder] = getattr(import_module(f"{package.__name__}.{module}"), name)
    return MappingProxyType(found)


FAMILIES: Mapping[str, ModelFamily] = MappingProxyType(
    {family.name: family for family in of_shipped("family", "FAMILY").values()}
)

_DESCRIPTIONS = (".yaml", ".yml")
_PROGRAMS = (".py",)


@dataclass(frozen=True)
class _Given:
    """A family that was handed over on purpose, and the file it came from."""

    family: ModelFamily
    path: Path | None


_given: ContextVar[tuple[_Given, ...]] = ContextVar("given families", default=())


@contextmanager
def using_families(*families: ModelFamily, path: Path | None = None) -> Iterator[None]:
    """Let `find_family` know `families` by their names, and by `path` if they come from a file.

    One that it knows already, the very same, stays as it is.

    Raises
    ------
    RigctlError
        a family is not sound, or its name is taken.
    """
    known = _given.get()
    for family in families:
        if any(given.family is family for given in known):
            continue
        if family.name in FAMILIES or family.name in {given.family.name for given in known}:
            raise RigctlError("there is a model family of this name already", value=family.name)
        known = (*known, _Given(with_derived_slots(check_family(family)), path))
    token = _given.set(known)
    try:
        yield
    finally:
        _given.reset(token)


@checks_argument_types
def find_family(written: str | Path, beside: str | Path | None = None) -> ModelFamily:
    """The family that a name or a path means.

    A path is tried relative to the folder of the file `beside` that names it (without one, to the current
    folder), to the project's root, and among the files that come with rigctl.

    Raises
    ------
    RigctlError
        there is no such family (it says the nearest) or no such file, the file is wrong, or it is a program.
    """
    written = str(written)
    if is_family_file(written):
        return _of_file(written, Path(beside) if beside is not None else None)
    known = {**FAMILIES, **{given.family.name: given.family for given in _given.get()}}
    return known[written] if written in known else _installed_family(written)


def is_family_file(written: str) -> bool:
    """Whether what a user wrote names a file, rather than a family by its name."""
    return written.casefold().endswith((*_DESCRIPTIONS, *_PROGRAMS))


def family_names() -> tuple[str, ...]:
    """The names that `find_family` knows; nothing is loaded."""
    given = (given.family.name for given in _given.get())
    return tuple(dict.fromkeys((*FAMILIES, *given, *(point.name for point in _entry_points()))))


def _of_file(written: str, beside: Path | None) -> ModelFamily:
    from rigctl.physics.user import load_family

    path = Path(written)
    if beside is not None or not path.exists():
        project = find_project(beside.parent if beside is not None else None)
        path = project.resolve(written, relative_to=beside)
    for given in _given.get():
        if given.path is not None and given.path.resolve() == path.resolve():
            return given.family
    if path.suffix.casefold() in _PROGRAMS:
        raise RigctlError(
            "a Python file is not run because another file names it",
            value=written,
            hint=f"If you trust it, name it on the command line: '--family {path}'; or install it as a "
            f"package that registers its family under the entry point group '{ENTRY_POINTS}'",
        )
    return load_family(path, taken=FAMILIES)


def _entry_points() -> tuple[EntryPoint, ...]:
    from importlib.metadata import entry_points

    return tuple(entry_points(group=ENTRY_POINTS))


@lru_cache(maxsize=32)
def _installed_family(name: str) -> ModelFamily:
    found = [point for point in _entry_points() if point.name == name]
    if not found:
        raise unknown_name("model family", name, family_names())
    what = f"what is registered as the model family {name!r}"
    try:
        loaded = found[0].load()
    except Exception as problem:  # a foreign package may fail in any way
        raise RigctlError(f"{what} cannot be loaded: {problem}") from problem
    family = as_family(loaded, what)
    if family.name != name:
        raise RigctlError(f"{what} has another name", value=family.name, expected=name)
    return with_derived_slots(check_family(family))


def as_family(made: object, what: str) -> ModelFamily:
    """The family that `made` is, or that it returns when it is called.

    Raises
    ------
    RigctlError
        it is none, or the call fails; `what` is what messages call it.
    """
    if callable(made):
        try:
            made = made()
        except RigctlError:
            raise
        except Exception as problem:  # it is a user's own function
            raise RigctlError(f"{what} fails: {type(problem).__name__}: {problem}") from problem
    if not isinstance(made, ModelFamily):
        raise RigctlError(f"{what} is no model family", value=repr(made), expected="a ModelFamily")
    return made
