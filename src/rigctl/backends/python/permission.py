"""Which Python packages may be imported for drivers: those that the user has allowed, and no others.

A rig file names any package, and importing one executes it; the file may come from a stranger, with its whole
folder, ``rigctl.toml`` included. A package is therefore allowed only by ``--allow-driver``, or by an answer
at the terminal. The answer is kept for the project in a file of the user, and so is ``--allow-driver`` for a
package that ``drivers = ["pymeasure"]`` in ``rigctl.toml`` lists; for any other it is for one command.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from importlib.util import find_spec
from pathlib import Path

from rigctl.errors import RigctlError, nearest_name
from rigctl.files.private import is_private, private_folder
from rigctl.files.regular import read_text
from rigctl.project import Project, find_project

#: allowed for the command that is carried out, and how the user is asked; None where nobody can be
_given: set[str] = set()
_ask: Callable[[str], bool] | None = None


def require_allowed(package: str) -> None:
    """Require that a package is installed, and that the user has allowed it for drivers.

    Raises
    ------
    RigctlError
        it is not.
    """
    project = find_project()
    known = {*_given, *_kept(project)}
    if package in sys.stdlib_module_names:
        require_package(package)
    listed = package in project.drivers
    if package not in known and not _asked(package, project):
        raise RigctlError(
            "this package has not been allowed to be imported for a driver",
            value=package,
            nearest=nearest_name(package, known),
            hint=f"--allow-driver {package} allows it {'for this project' if listed else 'for one command'}",
        )
    require_package(package)
    if listed and package in _given:
        _keep(package, project)


def require_package(package: str, before: str = "") -> None:
    """Require that a name is that of an installed package which may be one of drivers; nothing is imported.

    Raises
    ------
    RigctlError
        it is not; the message begins with `before`.
    """
    if package in sys.stdlib_module_names:
        raise RigctlError(f"{before}a module of Python itself is no driver", value=package)
    if not package.isidentifier():
        raise RigctlError(f"{before}no name of a package", value=package, expected="e.g. pymeasure")
    if find_spec(package) is None:
        near = nearest_name(package, _installed())
        raise RigctlError(
            f"{before}the package of the driver is not installed",
            value=package,
            nearest=near,  # and no advice to install what a misspelt name may be that of
            hint=None if near else f"pip install {package}, or the distribution that has it",
        )


def allowed() -> set[str]:
    """Return the packages that may be imported for drivers."""
    return {*_given, *_kept(find_project())}


def _installed() -> Iterator[str]:
    """Yield the names of packages that can be imported: those that the project lists come first."""
    from importlib.metadata import packages_distributions

    yield from (one for one in find_project().drivers if find_spec(one) is not None)
    yield from (one for one in packages_distributions() if one.isidentifier() and not one.startswith("_"))


def distribution(package: str) -> str:
    """Return the name and version of the distribution that has a package, without importing it."""
    from importlib.metadata import PackageNotFoundError, packages_distributions, version

    for name in (package, *packages_distributions().get(package, ())):
        try:
            return f"{name} {version(name)}"
        except PackageNotFoundError:
            continue
    return f"{package} of unknown version"


@contextmanager
def allowing(packages: Collection[str], ask: Callable[[str], bool] | None = None) -> Iterator[None]:
    """Allow packages meanwhile; `ask` is asked about others, once each."""
    global _ask  # noqa: PLW0603 - there is one user
    before, earlier = set(_given), _ask
    _given.update(packages)
    _ask = ask
    try:
        yield
    finally:
        _given.clear()
        _given.update(before)
        _ask = earlier


def _asked(package: str, project: Project) -> bool:
    if _ask is None or not _ask(package):
        return False
    _given.add(package)
    _keep(package, project)
    return True


def _kept(project: Project) -> Collection[str]:
    """Return the packages that the user has allowed for this project."""
    path = _file()
    with suppress(OSError, ValueError):
        if is_private(path):
            found = _read(path).get(str(project.root), ())
            return [one for one in found if isinstance(one, str)]
    return ()


def _keep(package: str, project: Project) -> None:
    path, root = _file(), str(project.root)
    try:
        private_folder(path.parent)
        found = dict(_read(path)) if path.exists() else {}
        found[root] = sorted({*found.get(root, ()), package})
        path.write_text(json.dumps(found, indent=1), encoding="utf-8")
    except (OSError, ValueError):
        return  # it is asked again


def _read(path: Path) -> Mapping[str, list[str]]:
    found = json.loads(read_text(path))
    if not isinstance(found, dict):
        raise ValueError("no table of projects")
    return found


def _file() -> Path:
    from platformdirs import user_config_path

    return user_config_path("rigctl", appauthor=False) / "drivers.json"
