"""``run.json``: everything about a run but its numbers, and the checksums of the files that hold them."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from rigctl.errors import ExitCode, Location, RigctlError
from rigctl.files.write import write_json

NAME: Final = "run.json"
#: status of a run that a program is carrying out, or was when it was killed
RUNNING: Final = "running"


def read_info(folder: Path) -> dict[str, Any]:
    """The content of a run's ``run.json``.

    Raises
    ------
    RigctlError
        there is none, or it is damaged.
    """
    path = folder / NAME
    try:
        info = json.loads(path.read_text(encoding="utf-8"))
    except OSError as problem:
        raise RigctlError(f"no run: {problem.strerror}", where=Location(path)) from problem
    except ValueError as problem:
        raise _damaged(path) from problem
    if not isinstance(info, dict) or "id" not in info or "status" not in info:
        raise _damaged(path)
    return info


def write_info(folder: Path, info: Mapping[str, Any]) -> None:
    """Replace ``run.json`` in one step."""
    write_json(folder / NAME, info)


def file_facts(path: Path) -> dict[str, Any]:
    """Size and SHA-256 of a file, as ``run.json`` keeps them."""
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    return {"sha256": digest, "bytes": path.stat().st_size}


def _damaged(path: Path) -> RigctlError:
    return RigctlError(
        "the file is damaged",
        hint=f"'rigctl runs verify {path.parent.name}' says what can be saved",
        where=Location(path),
        exit_code=ExitCode.FAILED,
    )
