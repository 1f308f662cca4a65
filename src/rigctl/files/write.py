"""Writes files atomically: completely or not at all.

In: a path, and text, bytes or plain values. Out: the file, or a `RigctlError` and the file as it was: the
content is written to a temporary file in the same folder, flushed to disk and renamed, so that neither a
full disk nor a kill leaves half of it.

`write_new` is for files that must never change, such as versions of a model: it fails if there is one,
also if two processes write at once, and makes the file read-only. On Windows a file that another program
has open cannot be replaced; that is waited for, but not for long.
"""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from datetime import date
from enum import Enum
from pathlib import Path, PurePath
from typing import Any

from rigctl.errors import ExitCode, Location, RigctlError
from rigctl.files.in_use import in_use, patiently
from rigctl.json_values import finite_or_none


def write_text(path: Path, text: str) -> None:
    """Write UTF-8 text atomically: a reader, also after a crash, finds either the old file or the new one.

    Raises
    ------
    RigctlError
        the folder cannot be written to, or the disk is full; the old file is unchanged.
    """
    write_bytes(path, text.encode("utf-8"))


def write_bytes(path: Path, content: bytes) -> None:
    """Write bytes as `write_text`: to a temporary file in the same folder, flushed to disk, then renamed."""
    with write_error(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary = _draft(path, content)
        try:
            _keep_mode(path, temporary)
            replace_file(temporary, path)
        except BaseException:
            with suppress(OSError):
                temporary.unlink()
            raise


def write_new(path: Path, content: bytes) -> None:
    """Write a file that must not exist yet, completely or not at all, and make it read-only.

    Raises
    ------
    FileExistsError
        there is such a file; it is unchanged.
    RigctlError
        the folder cannot be written to, or the disk is full.
    """
    taken = False
    with write_error(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary = _draft(path, content)
        try:
            _publish(temporary, path, content)
        except FileExistsError:
            taken = True
        finally:
            with suppress(OSError):
                temporary.unlink()
    if taken:
        raise FileExistsError(path)
    with write_error(path):  # not earlier, since Windows would not remove the draft, which is the same file
        path.chmod(0o444)


def replace_file(draft: Path, path: Path, patience: float = 0.5) -> None:
    """Rename `draft` to `path`, replacing the file there.

    Windows refuses this while another program has the file open. rigctl itself keeps a file open for less
    than a millisecond, a virus scanner somewhat longer: the renaming is retried for `patience` s.

    Raises
    ------
    OSError
        it is refused for longer, or for another reason.
    """
    patiently(lambda: draft.replace(path), patience)


def move_folder(folder: Path, target: Path, patience: float = 5.0) -> Path:
    """Rename a folder of complete files; returns its new path.

    Windows refuses this while any program has one of these files open, as a virus scanner or the index of a
    search does with new ones: the renaming is retried for `patience` s.

    Raises
    ------
    OSError
        it is refused for longer, or for another reason: there is such a folder.
    """
    patiently(lambda: folder.rename(target), patience)
    return target


def _draft(path: Path, content: bytes) -> Path:
    """Write a temporary file in the folder of `path`, flushed to disk; if that fails, it is removed."""
    handle, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".tmp", dir=path.parent)
    temporary = Path(name)
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.write(content)
            stream.flush()
            os.fsync(stream.fileno())
    except BaseException:
        with suppress(OSError):
            temporary.unlink()
        raise
    return temporary


@contextmanager
def write_error(path: Path) -> Iterator[None]:
    """Convert errors of the operating system while writing to `path` to a `RigctlError`."""
    try:
        yield
    except OSError as problem:
        held = in_use(problem) and path.exists()
        raise RigctlError(
            f"cannot write the file: {problem.strerror or problem}",
            where=Location(path),
            hint="If another program has it open, as a spreadsheet may, close it there" if held else None,
            exit_code=ExitCode.FAILED,
        ) from problem


def _publish(temporary: Path, path: Path, content: bytes) -> None:
    """Give a complete file its final name, unless there is such a file."""
    try:
        path.hardlink_to(temporary)
    except FileExistsError:
        raise
    except (OSError, NotImplementedError):  # a file system without hard links
        with path.open("xb") as stream:
            try:
                stream.write(content)
                stream.flush()
                os.fsync(stream.fileno())
            except OSError:  # a full disk: nothing rather than a part
                stream.close()
                path.unlink()
                raise


def _keep_mode(path: Path, temporary: Path) -> None:
    """Give the new file the permissions of the one that it replaces, or else 0o644."""
    try:
        mode = path.stat().st_mode & 0o777
    except FileNotFoundError:
        mode = 0o644
    temporary.chmod(mode)


def write_json(path: Path, value: object) -> None:
    """Write `value` as indented JSON (see `to_json`), atomically."""
    write_text(path, to_json(value) + "\n")


def to_json(value: object, *, indent: int | None = 2) -> str:
    """Return JSON that every reader accepts: NaN and infinity become null, paths and dates become text.

    A byte of a path that is no UTF-8 becomes a question mark.
    """
    text = json.dumps(_plain(value), indent=indent, ensure_ascii=False, allow_nan=False)
    return text if text.isascii() else text.encode("utf-8", "replace").decode("utf-8")


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [_plain(item) for item in value]
    if hasattr(value, "tolist"):  # numpy scalars and arrays, without importing numpy here
        return _plain(value.tolist())
    return _plain_scalar(value.value if isinstance(value, Enum) else value)


def _plain_scalar(value: object) -> str | bool | int | float | None:
    if value is None or isinstance(value, str | bool | int):
        return value
    if isinstance(value, float):
        return finite_or_none(value)
    if isinstance(value, date):
        return value.isoformat()
    if isinstance(value, PurePath):
        return value.as_posix()
    if isinstance(value, os.PathLike):
        return str(os.fspath(value))
    raise TypeError(f"cannot write a {type(value).__name__} as JSON")
