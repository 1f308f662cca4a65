"""An FMU as a part of a model: which of its variables are connected, and whether it may run.

An FMU is a program with the user's permissions. A file that names one never makes it run: the user names the
FMU itself on the command line (`allow`), as for a family of models in Python. What is allowed is its content.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from rigctl.errors import Location, RigctlError
from rigctl.files.regular import read_bytes
from rigctl.fmu.description import Kind, Port

#: SHA-256 of the FMUs that the user has named in this command
_ALLOWED: set[str] = set()


@dataclass(frozen=True)
class Program:
    """An FMU with its connected variables, by their names in the model.

    Attributes
    ----------
    path, sha256: of the file.
    kind: how it is simulated.
    inputs, outputs, parameters: those that the model uses, in order.
    sizes: of each parameter a change that matters, SI.
    starts: of each output the variable that sets its value at the start; None if it cannot be set.
    """

    path: Path
    sha256: str
    kind: Kind
    inputs: Mapping[str, Port]
    outputs: Mapping[str, Port]
    parameters: Mapping[str, Port]
    sizes: Mapping[str, float]
    starts: Mapping[str, Port | None]


def digest(path: Path) -> str:
    """SHA-256 of a file."""
    return hashlib.sha256(read_bytes(path)).hexdigest()


def allow(sha256: str) -> None:
    """Let the FMU with this content run in this process and those that it starts."""
    _ALLOWED.add(sha256)


def is_allowed(sha256: str) -> bool:
    """Whether the user has named the FMU with this content."""
    return sha256 in _ALLOWED


def require_allowed(program: Program) -> None:
    """Refuse to run an FMU that only a file names.

    Raises
    ------
    RigctlError
        the user has not named it, or it has changed since its family file was read.
    """
    if not is_allowed(program.sha256):
        raise RigctlError(
            "an FMU is a program, and is not run because a file names it",
            where=Location(program.path),
            hint=f"If you trust it, name it on the command line: '--family {program.path.as_posix()}'",
        )
