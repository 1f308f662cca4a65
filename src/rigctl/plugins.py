"""What other installed packages add to rigctl, by the groups of their entry points.

Installing a package is the decision to run it. The entry points are read only when a name is wanted that
rigctl itself does not know, so that no command starts more slowly because of them; only the one of that name
is loaded.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Final

from rigctl.errors import RigctlError

#: the group of backends, each a module or an object with ``create(rig, clock, options)``; it is wanted in
#: several rooms, other groups are named where they are used
BACKENDS: Final = "rigctl.backends"
#: by group, what its entries are
GROUPS: Final = {
    BACKENDS: "a backend",
    "rigctl.importers": "a reader of files",
    "rigctl.exporters": "a writer of files",
    "rigctl.families": "a family of models",
    "rigctl.effects": "effects",
}


@dataclass(frozen=True)
class Plugin:
    """One entry of an installed package, and why it cannot be loaded; empty if it can."""

    group: str
    name: str
    package: str
    trouble: str


def plugin_names(group: str) -> tuple[str, ...]:
    """Return the names of the entries of a group; nothing is loaded."""
    return tuple(sorted({point.name for point in entry_points(group=group)}))


def load_plugin(group: str, name: str) -> Any:
    """Return what a package has registered under a name; None if none has.

    Raises
    ------
    RigctlError
        it cannot be loaded.
    """
    for point in entry_points(group=group):
        if point.name == name:
            try:
                return point.load()
            except Exception as error:
                raise RigctlError(
                    f"{GROUPS[group]} registered by the package {_package(point)} cannot be loaded",
                    value=name,
                    hint=f"{type(error).__name__}: {error}",
                ) from error
    return None


def examine_plugins() -> Iterator[Plugin]:
    """Load every entry, for a report; what fails in one of them is its trouble."""
    for group in GROUPS:
        for point in entry_points(group=group):
            trouble = ""
            try:
                point.load()
            except Exception as error:  # noqa: BLE001 - a foreign package may fail in any way
                trouble = f"{type(error).__name__}: {error}"
            yield Plugin(group, point.name, _package(point), trouble)


def _package(point: EntryPoint) -> str:
    return "?" if point.dist is None else f"{point.dist.name} {point.dist.version}"
