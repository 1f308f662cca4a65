"""Model families by name, or by the file that describes one.

A name is looked up among the families shipped with rigctl (the folders of `rigctl.families`), those given
explicitly to the command (`using_families`), and those that installed packages register under the entry point
group ``rigctl.families``. A YAML file named here is read, and nothing in it is executed; a Python file named
here is not executed.
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
from rigctl.command_line import shell_word
from rigctl.errors import RigctlError, unknown_name
from rigctl.physics.derived_slots import with_derived_slots
from rigctl.physics.family import ModelFamily
from rigctl.physics.family_checks import check_family
from rigctl.project import find_project

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

ENTRY_POINTS = "rigctl.families"

#: the package whose folders are the shipped families
SHIPPED = "rigctl.families"


def of_shipped(module: str, name: str) -> Mapping[str, Any]:
    """The object `name` in the `module` of each shipped family that has this module, by its folder.

    They are looked up like plug-ins, so that no package below the families imports one of them.
    """
    shipped = import_module(SHIPPED)
    objects = {}
    for folder in dict.fromkeys((*shipped.FIRST, *(item.name for item in iter_modules(shipped.__path__)))):
        package = import_module(f"{SHIPPED}.{folder}")
        if module in {part.name for part in iter_modules(package.__path__)}:
            objects[folder] = getattr(import_module(f"{package.__name__}.{module}"), name)
    return MappingProxyType(objects)


FAMILIES: Mapping[str, ModelFamily] = MappingProxyType(
    {family.name: family for family in of_shipped("family", "FAMILY").values()}
)

_DESCRIPTIONS = (".yaml", ".yml")
_PROGRAMS = (".py",)


@dataclass(frozen=True)
class _Given:
    """A family that was given explicitly, and the file from which it was loaded."""

    family: ModelFamily
    path: Path | None


_given: ContextVar[tuple[_Given, ...]] = ContextVar("given families", default=())


@contextmanager
def using_families(*families: ModelFamily, path: Path | None = None) -> Iterator[None]:
    """Let `find_family` find `families` by their names, and by `path` if they come from a file.

    A family object that it knows already is not added again.

    Raises
    ------
    RigctlError
        a family is invalid, or its name is taken.
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
    """The family with the given name, or the one described by the file at the given path.

    A path is resolved relative to the folder of the file `beside` that names it (without one, to the current
    folder), to the project's root, or among the shipped files.

    Raises
    ------
    RigctlError
        there is no such family (the message gives the nearest name) or file, the file is invalid, or it is a
        Python file that was not given explicitly.
    """
    written = str(written)
    if written.casefold().endswith(".fmu"):
        raise RigctlError(
            "an FMU is no family by itself: a family file says which of its variables are commanded and read",
            value=written,
            expected="a family file that names it",
            hint=f"'rigctl family new NAME --fmu {shell_word(written)}' drafts one",
        )
    if is_family_file(written):
        return _of_file(written, Path(beside) if beside is not None else None)
    known = {**FAMILIES, **{given.family.name: given.family for given in _given.get()}}
    return known[written] if written in known else _installed_family(written)


def is_family_file(written: str) -> bool:
    """Whether a user's text names a file, rather than a family by its name."""
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
            hint=f"If you trust it, name it on the command line: '--family {path.as_posix()}'; or install it "
            f"as a package that registers its family under the entry point group '{ENTRY_POINTS}'",
        )
    return load_family(path, taken=FAMILIES)


def _entry_points() -> tuple[EntryPoint, ...]:
    from importlib.metadata import entry_points

    return tuple(entry_points(group=ENTRY_POINTS))


@lru_cache(maxsize=32)
def _installed_family(name: str) -> ModelFamily:
    points = [point for point in _entry_points() if point.name == name]
    if not points:
        raise unknown_name("model family", name, family_names())
    what = f"what is registered as the model family {name!r}"
    try:
        loaded = points[0].load()
    except Exception as problem:  # a foreign package may fail in any way
        raise RigctlError(f"{what} cannot be loaded: {problem}") from problem
    family = as_family(loaded, what)
    if family.name != name:
        raise RigctlError(f"{what} has another name", value=family.name, expected=name)
    return with_derived_slots(check_family(family))


def as_family(candidate: object, what: str) -> ModelFamily:
    """`candidate` if it is a family, or the family that it returns if it is callable.

    Raises
    ------
    RigctlError
        it is not a family, or the call fails; `what` is its name in messages.
    """
    if callable(candidate):
        try:
            candidate = candidate()
        except RigctlError:
            raise
        except Exception as problem:  # a user's function may fail in any way
            raise RigctlError(f"{what} fails: {type(problem).__name__}: {problem}") from problem
    if not isinstance(candidate, ModelFamily):
        raise RigctlError(f"{what} is no model family", value=repr(candidate), expected="a ModelFamily")
    return candidate
