"""``run.json``: everything about a run but its numbers, and the checksums of the files that hold them."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from rigctl.errors import ExitCode, Location, RigctlError
from rigctl.files.write import to_json, write_json

NAME: Final = "run.json"
#: the field that holds the SHA-256 of all others, in their canonical text
_CHECKSUM: Final = "checksum"
#: the first format that has it
_PROTECTED: Final = 2
#: status of a run that a program is carrying out, or was when it was killed
RUNNING: Final = "running"
_canonical: Final = json.JSONEncoder(sort_keys=True, separators=(",", ":"), ensure_ascii=True).encode


def read_info(folder: Path) -> dict[str, Any]:
    """The content of a run's ``run.json``.

    Raises
    ------
    RigctlError
        there is none, it is damaged or was changed since it was written, or it is another run's.
    """
    try:
        # of many runs a Path for each file takes as long as to read it
        with open(f"{folder}{os.sep}{NAME}", "rb") as file:  # noqa: PTH123
            text = file.read().decode("utf-8")
    except OSError as problem:
        raise RigctlError(f"no run: {problem.strerror}", where=Location(folder / NAME)) from problem
    except ValueError as problem:
        raise _damaged(folder / NAME) from problem
    info = _checked(text, folder)
    require_own(folder, info["id"], folder / NAME)
    return info


def read_text(text: str, folder: os.PathLike[str]) -> dict[str, Any]:
    """The content of a ``run.json`` that has been read from `folder`, wherever that is.

    Raises
    ------
    RigctlError
        it is damaged or was changed since it was written, or it is another run's.
    """
    address = os.fspath(folder)
    info = _checked(text, Path(address))
    if info["id"] != address.rpartition("/")[2]:
        raise RigctlError("the file belongs to another run", value=str(info["id"]), expected=address)
    return info


def _checked(text: str, folder: Path) -> dict[str, Any]:
    try:
        info = json.loads(text)
    except ValueError as problem:
        raise _damaged(folder / NAME) from problem
    if not isinstance(info, dict) or "id" not in info or "status" not in info:
        raise _damaged(folder / NAME)
    if info.get("format", _PROTECTED) >= _PROTECTED and info.get(_CHECKSUM) != _digest(info):
        raise _damaged(folder / NAME, "the file was changed since it was written")
    return info


def require_own(folder: Path, run_id: object, path: Path) -> None:
    """Refuse a file of a run's folder that names another run: what it says would be written there.

    Raises
    ------
    RigctlError
        the id is not the folder's name; a folder that is just being made has none yet.
    """
    # a link may have any name; to follow every part of a path takes longer than to read the file
    name = folder.resolve().name if folder.is_symlink() or run_id != folder.name else folder.name
    if run_id != name and not name.startswith("."):
        raise RigctlError(
            "the file belongs to another run",
            value=str(run_id),
            expected=name,
            hint="A run's folder keeps the name of the run's id",
            where=Location(path),
            exit_code=ExitCode.FAILED,
        )


def write_info(folder: Path, info: Mapping[str, Any]) -> None:
    """Replace ``run.json`` in one step, with the checksum of what it says.

    The folder that the run lies in is marked as changed: by that the catalogue sees which runs to read again.
    """
    said = {key: value for key, value in info.items() if key != _CHECKSUM}
    write_json(folder / NAME, {**said, _CHECKSUM: checksum(said)})
    with suppress(OSError):
        os.utime(folder.parent)


def checksum(info: Mapping[str, Any]) -> str:
    """SHA-256 of the canonical text of ``run.json``: its fields but this one, keys sorted, without blanks.

    The text is compared as JSON reads it back, so that formatting does not matter and any value does.
    """
    return _digest(json.loads(to_json(info)))


def _digest(info: Mapping[str, Any]) -> str:
    """`checksum` of what was read from JSON."""
    said = {key: value for key, value in info.items() if key != _CHECKSUM}
    return hashlib.sha256(_canonical(said).encode("ascii")).hexdigest()


def set_aside(folder: Path) -> Path | None:
    """Keep a damaged or changed ``run.json`` under another name; None where there is none."""
    path = folder / NAME
    if not path.exists():
        return None
    number = 1
    while (kept := folder / f"{NAME}.changed-{number}").exists():
        number += 1
    kept.write_bytes(path.read_bytes())
    return kept


def file_facts(path: Path) -> dict[str, Any]:
    """Size and SHA-256 of a file, as ``run.json`` keeps them."""
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    return {"sha256": digest, "bytes": path.stat().st_size}


def _damaged(path: Path, what: str = "the file is damaged") -> RigctlError:
    return RigctlError(
        what,
        hint=f"'rigctl runs verify {path.parent.name}' says what can be saved",
        where=Location(path),
        exit_code=ExitCode.FAILED,
    )
