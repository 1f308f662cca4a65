"""``run.json``: the metadata of a run, and the checksums of its data files.

It is the one file that is read of every run in a list, and the one that says whether the others are whole:
hence a checksum of its own, over the parsed content, so that reformatting it does no harm and changing it is
noticed. A file of the first format has none; in any other a missing checksum counts as damage.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from rigctl.dataset.run_fields import foreign_file, wrong_field
from rigctl.errors import ExitCode, Location, RigctlError
from rigctl.files.regular import regular
from rigctl.files.write import to_json, write_json
from rigctl.json_values import parse_json

NAME: Final = "run.json"
#: the field with the SHA-256 of all others, in their canonical text
_CHECKSUM: Final = "checksum"
#: the first format that has this field
_PROTECTED: Final = 2
#: status of a run in progress, or of one whose program was killed
RUNNING: Final = "running"
_canonical: Final = json.JSONEncoder(sort_keys=True, separators=(",", ":"), ensure_ascii=True).encode


def read_info(folder: Path) -> dict[str, Any]:
    """Read a run's ``run.json``.

    Raises
    ------
    RigctlError
        it is missing, damaged, was changed since it was written, or belongs to another run.
    """
    try:
        # making a Path for each file takes as long as reading it
        with open(f"{folder}{os.sep}{NAME}", "rb", opener=regular) as file:
            text = file.read().decode("utf-8")
    except OSError as problem:
        raise RigctlError(f"no run: {problem.strerror}", where=Location(folder / NAME)) from problem
    except ValueError as problem:
        raise _damaged(folder / NAME, folder.name) from problem
    info = _checked(text, f"{folder.as_posix()}/{NAME}", folder.name)
    require_own(folder, info["id"], folder / NAME)
    return info


def read_text(text: str, folder: os.PathLike[str]) -> dict[str, Any]:
    """Parse the text of a ``run.json`` from any `folder`.

    Raises
    ------
    RigctlError
        it is damaged, was changed since it was written, or belongs to another run.
    """
    address = os.fspath(folder)
    run_id = address.rpartition("/")[2]
    info = _checked(text, f"{address}/{NAME}", run_id)  # no Path: it would change '//'
    if info["id"] != run_id:
        raise RigctlError("the file belongs to another run", value=str(info["id"]), expected=address)
    return info


def _checked(text: str, file: str, run_id: str) -> dict[str, Any]:
    try:
        info = parse_json(text)
    except ValueError as problem:
        raise _damaged(file, run_id) from problem
    if not isinstance(info, dict) or "id" not in info or "status" not in info:
        raise _damaged(file, run_id)
    # The checksum before the fields: what was changed is not interpreted.
    if not _is_unprotected(info) and info.get(_CHECKSUM) != _digest(info):
        raise _damaged(file, run_id, "the file was changed since it was written")
    if (wrong := wrong_field(info)) is not None:
        raise _damaged(file, run_id, f"'{wrong}' is not what rigctl writes there")
    if foreign_file(info):
        raise _damaged(file, run_id, "it names a file that is not in the run's folder")
    return info


def _is_unprotected(info: Mapping[str, Any]) -> bool:
    """Whether it is of the first format, which had no checksum; no other value omits the check."""
    stated = info.get("format")
    return type(stated) is int and 1 <= stated < _PROTECTED and _CHECKSUM not in info


def require_own(folder: Path, run_id: object, path: Path) -> None:
    """Refuse a file in a run's folder that names another run, since data would be written to that run.

    Raises
    ------
    RigctlError
        the id differs from the folder's name; a folder in the making has no id yet.
    """
    # a link may have any name; resolving every part of a path takes longer than reading the file
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
    """Replace ``run.json`` atomically, with the checksum of its content.

    The folder that contains the run is touched, so that the catalogue finds the runs to read again.
    """
    content = {key: value for key, value in info.items() if key != _CHECKSUM}
    write_json(folder / NAME, {**content, _CHECKSUM: checksum(content)})
    with suppress(OSError):
        os.utime(folder.parent)


def checksum(info: Mapping[str, Any]) -> str:
    """Return the SHA-256 of the canonical text of ``run.json``: its other fields, sorted, without blanks.

    The text is parsed first, so that the formatting does not matter, but every value does.
    """
    return _digest(json.loads(to_json(info)))


def _digest(info: Mapping[str, Any]) -> str:
    """Return the `checksum` of parsed JSON."""
    content = {key: value for key, value in info.items() if key != _CHECKSUM}
    return hashlib.sha256(_canonical(content).encode("ascii")).hexdigest()


def set_aside(folder: Path) -> Path | None:
    """Rename a damaged or changed ``run.json``; None if there is none."""
    path = folder / NAME
    if not path.exists():
        return None
    number = 1
    while (target := folder / f"{NAME}.changed-{number}").exists():
        number += 1
    try:
        with open(path, "rb", opener=regular) as file:
            content = file.read()
    except OSError:  # a folder, a pipe or a device: it has no content, and makes room for the file
        path.rename(target)
        return target
    target.write_bytes(content)
    return target


def file_facts(path: Path) -> dict[str, Any]:
    """Return the size and SHA-256 of a file, for ``run.json``."""
    with open(path, "rb", opener=regular) as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    return {"sha256": digest, "bytes": path.stat().st_size}


def _damaged(file: Path | str, run_id: str, what: str = "the file is damaged") -> RigctlError:
    return RigctlError(
        what,
        hint=f"'rigctl runs verify {run_id}' says what can be saved",
        where=Location(file),
        exit_code=ExitCode.FAILED,
    )
