"""A project: its root, the folder of its runs, and the resolution of paths in its files.

In: a folder, by default the current one. Out: a `Project`, with the settings of the nearest `rigctl.toml`
above it; without one, the folder itself is the root, so that commands work before there is a project.

A path in a file is tried beside that file, then from the root, then among the files that come with
rigctl: a project can be moved, and a procedure can name a shipped rig. The settings may come from a
stranger with the rest of the folder. Therefore they list the packages of drivers, but allow none; consent
is kept with the user.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PureWindowsPath

from rigctl.errors import Location, RigctlError, nearest_name, unknown_name
from rigctl.files.regular import read_text
from rigctl.files.shipped import shipped
from rigctl.files.version_suffix import path_exists
from rigctl.printable import shown_path

MARKER = "rigctl.toml"
_KINDS = {
    "runs": "a folder",
    "rig": "a rig file",
    "drivers": 'the names of packages, e.g. ["pymeasure"]',
}
#: start of an address of storage; a Windows drive has one letter and no slashes
_ADDRESS = re.compile(r"[a-zA-Z][a-zA-Z0-9+.-]+://")


@dataclass(frozen=True)
class Project:
    """A folder with rigs, procedures and models, and the folder of its runs.

    `store` is the address of the storage to which closed runs are uploaded, ``s3://bucket/runs``; None for
    none. `rig` is the rig file of commands that name none. `drivers` are the Python packages of its
    drivers of devices; the user's consent to import one is kept for the project.
    """

    root: Path
    runs: Path
    rig: Path | None = None
    store: str | None = None
    drivers: tuple[str, ...] = ()

    def resolve(self, path: str | Path, relative_to: Path | None = None) -> Path:
        """The file to which a path in a file refers.

        The path is tried relative to the folder of the file `relative_to`, then to the project's root, then
        among the shipped files. ``m.yaml@3``, version 3 of ``m.yaml``, is found where ``m.yaml`` is.

        Raises
        ------
        RigctlError
            there is no such file; the message lists the paths that were tried.
        """
        wanted = _expanded(path)
        folders = [*([relative_to.parent] if relative_to is not None else []), self.root, shipped()]
        tried = [folder / wanted for folder in folders]
        # `models\\a.yaml`, as it was written on another computer, is `models/a.yaml`
        elsewhere = [folder / PureWindowsPath(path).as_posix() for folder in folders if "\\" in str(path)]
        for candidate in (*tried, *elsewhere):
            if path_exists(candidate):
                return candidate
        places = list(dict.fromkeys(candidate.as_posix() for candidate in tried))
        raise RigctlError(
            "there is no such file",
            value=shown_path(path),
            nearest=_nearest_file(wanted, tried),
            hint=f"Looked for {', '.join(places)}",
        )


def find_project(start: Path | None = None) -> Project:
    """The project that contains `start` (the current folder by default).

    Its root is the nearest folder upwards with a ``rigctl.toml``, or else `start`. Runs are stored in
    ``runs/`` below it, or in the folder given by ``runs = "..."`` in ``rigctl.toml``; if that is an address,
    ``s3://bucket/runs``, they are in ``runs/``, and are uploaded to it once they are closed. ``rig = "..."``
    is the rig file of commands that name none, ``drivers = ["..."]`` lists the Python packages of its
    drivers of devices, which the user has to allow.

    Raises
    ------
    RigctlError
        ``rigctl.toml`` cannot be read, or contains an unknown setting or an invalid value.
    """
    here = (start or Path.cwd()).absolute()
    for folder in (here, *here.parents):
        marker = folder / MARKER
        if marker.is_file():
            settings = _read_settings(marker)
            rig, runs = settings.paths.get("rig"), settings.paths.get("runs", "runs")
            store = runs if is_address(runs) else None
            return Project(
                folder,
                folder / (_expanded(runs) if store is None else "runs"),
                folder / _expanded(rig) if rig else None,
                store,
                settings.drivers,
            )
    return Project(here, here / "runs")


def find_file(written: Path) -> Path:
    """A file named on a command line: in the current folder, the project, or among the shipped files.

    ``m.yaml@3``, version 3 of a model file, is found where ``m.yaml`` is.

    Raises
    ------
    RigctlError
        there is no such file.
    """
    return written if path_exists(written) else find_project().resolve(written)


def own_model(written: Path) -> Path:
    """A model file that is to be changed: in the current folder or the project.

    Raises
    ------
    RigctlError
        there is none, or it is one of the shipped files.
    """
    path = find_file(written)
    if not path_exists(written) and not path.is_relative_to(find_project().root):
        raise RigctlError(
            "this model comes with rigctl and is not changed",
            value=written.as_posix(),
            hint="Copy it into your project, or make one that has it with 'rigctl init'",
        )
    return path


def is_address(text: object) -> bool:
    """Whether this is an address of storage, ``s3://bucket/runs``, and not a path."""
    return isinstance(text, str) and _ADDRESS.match(text) is not None


def require_local(path: Path) -> None:
    """Refuse a path that was written as an address of storage.

    Raises
    ------
    RigctlError
        its first part is a scheme, ``s3:``; conversion to a path removes the second slash of the address.
    """
    first, *rest = path.parts or ("",)
    address = f"{first}//{'/'.join(rest)}"
    if rest and is_address(address):
        raise RigctlError(
            "an address of storage is no local file",
            value=address,
            expected="a path on this computer",
            hint="Runs are read at such addresses; other files are not",
        )


@dataclass(frozen=True)
class _Settings:
    """What a project file says: paths by name, and the packages of drivers."""

    paths: dict[str, str]
    drivers: tuple[str, ...] = ()


def _read_settings(marker: Path) -> _Settings:
    """The settings in the project file."""
    import tomllib

    where = Location(marker)
    try:
        settings = tomllib.loads(read_text(marker, "utf-8-sig"))
    except tomllib.TOMLDecodeError as problem:
        raise RigctlError(f"not valid TOML: {problem}", where=where) from problem
    except UnicodeDecodeError as problem:
        raise RigctlError("the file is not UTF-8 text", expected="UTF-8", where=where) from problem
    except OSError as problem:
        raise RigctlError(f"cannot read the file: {problem.strerror or problem}", where=where) from problem
    found: dict[str, str] = {}
    drivers: tuple[str, ...] = ()
    for name, written in settings.items():
        if name not in _KINDS:
            raise unknown_name("setting", name, _KINDS, where=where)
        if name == "drivers" and isinstance(written, list) and all(_is_package(one) for one in written):
            drivers = tuple(written)
        elif name != "drivers" and isinstance(written, str) and written and "\0" not in written:
            found[name] = written
        else:
            kind = _KINDS[name]
            raise RigctlError(f"{name}: wrong kind of value", value=str(written), expected=kind, where=where)
    return _Settings(found, drivers)


def _is_package(written: object) -> bool:
    return isinstance(written, str) and written.isidentifier()


def _nearest_file(wanted: Path, tried: Sequence[Path]) -> str | None:
    """The path, as it would be written, of a file with a similar name in a folder that was tried.

    An extension that both have says nothing about how similar they are; hidden files are not meant.
    """
    for place in tried:
        try:
            names = [entry.name for entry in place.parent.iterdir() if not entry.name.startswith(".")]
        except (OSError, ValueError):
            continue
        alike = {Path(name).stem: name for name in names if Path(name).suffix == wanted.suffix}
        near = nearest_name(wanted.stem, alike)
        found = alike[near] if near is not None else nearest_name(wanted.name, set(names) - {*alike.values()})
        if found is not None:
            return wanted.with_name(found).as_posix()
    return None


def _expanded(path: str | Path) -> Path:
    """The path with a leading ``~`` replaced by the home folder, if there is one."""
    try:
        return Path(path).expanduser()
    except RuntimeError:
        return Path(path)
