"""Files and runs of the project by what a page calls them: none that leads out of the project is touched."""

from __future__ import annotations

from pathlib import Path

from rigctl.errors import RigctlError


def project_files(root: Path, folder: str) -> list[str]:
    """The YAML files of a folder of the project, relative to its root."""
    directory = root / folder
    return [path.relative_to(root).as_posix() for path in sorted(directory.glob("*.yaml")) if path.is_file()]


def project_path(root: Path, name: str, *, hint: str | None = None) -> Path:
    """A path of the project by its path from the root, whether or not there is a file.

    Parameters
    ----------
    hint: what to do about a path that leads out of the project.

    Raises
    ------
    RigctlError
        it leads out of the project.
    """
    home = root.resolve()
    path = (home / name).resolve() if "\0" not in name else home
    if not path.is_relative_to(home) or path == home:
        raise RigctlError("the project has no such place", value=name, hint=hint)
    return path


def project_file(root: Path, name: str) -> Path:
    """A file of the project by its path from the root.

    Raises
    ------
    RigctlError
        it leads out of the project, or there is no such file.
    """
    path = project_path(root, name)
    if not path.is_file():
        raise RigctlError("the project has no such file", value=name)
    return path


def plain_id(text: str) -> str:
    """A run of this project by its id; a path is refused, as it could lead elsewhere.

    Raises
    ------
    RigctlError
        it is none.
    """
    if not text or text[0] in ".-" or set(text) & set("/\\:\0"):
        raise RigctlError("this is not a run's id", value=text)
    return text
