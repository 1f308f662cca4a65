"""Checks where a command may write: never into a run, and only over earlier files of the same kind."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from rigctl.dataset import run_json
from rigctl.dataset.recording import log
from rigctl.errors import Location, RigctlError
from rigctl.files.regular import regular
from rigctl.files.reserved_names import reserved_part

#: bytes that are read to recognise a file
_HEAD: Final = 4096
#: first bytes of figures: PNG, and SVG with or without an XML declaration
_FIGURES: Final = (b"\x89PNG\r\n\x1a\n", b"<svg", b"<?xml")


def is_page(head: bytes) -> bool:
    """Return whether the first bytes are those of a rigctl page."""
    return b'<meta name="generator" content="rigctl ' in head


def is_figure(head: bytes) -> bool:
    """Return whether the first bytes are those of a figure."""
    return head.lstrip().startswith(_FIGURES)


def is_schema(head: bytes) -> bool:
    """Return whether the first bytes are those of a JSON Schema."""
    return head.lstrip().startswith(b"{") and b"$schema" in head


def is_designed(head: bytes) -> bool:
    """Return whether the first bytes are those of a designed procedure."""
    return head.startswith(b"# Written by 'rigctl design'")


def require_output(
    path: Path,
    *,
    replaces: Callable[[bytes], bool] | None = None,
    force: bool = False,
    option: str = "--force",
    windows: bool = os.name == "nt",
) -> None:
    """Refuse a path where writing would destroy something else.

    Parameters
    ----------
    replaces: returns from the first bytes of an existing file whether it is an earlier product of the same
        kind, which is replaced without asking; None to replace nothing.
    force: replace any file except one of a run.
    option: the option for this, for messages; empty if there is none.
    windows: whether the system is Windows, where some names are devices.

    Raises
    ------
    RigctlError
        the path is in a run's folder or below a file, is a folder or a device, or is another file.
    """
    _require_no_device(path, windows=windows)
    _require_outside_runs(path)
    _require_no_file(path.parent)
    if path.is_dir():
        raise RigctlError("a folder is there", where=Location(path), expected="the name of a file")
    if not (path.exists() or path.is_symlink()) or force:
        return
    if replaces is None or not replaces(_head(path)):
        what = "the file exists already" if replaces is None else "a file of another kind exists already"
        raise RigctlError(
            what,
            where=Location(path),
            hint="Choose another name" + f"; '{option}' replaces it" * bool(option),
        )


def require_outputs(paths: Sequence[Path], *, replaces: Callable[[bytes], bool], force: bool = False) -> None:
    """Call `require_output` for several files."""
    for path in paths:
        require_output(path, replaces=replaces, force=force)


def require_folder(folder: Path, *, windows: bool = os.name == "nt") -> None:
    """Refuse a folder for new files, before the work that they are the result of; it need not exist.

    Raises
    ------
    RigctlError
        the folder is in a run's folder, or it or one above it is a file.
    """
    _require_no_device(folder, windows=windows)
    _require_outside_runs(folder)
    _require_no_file(folder)


def _require_no_device(path: Path, *, windows: bool) -> None:
    device = reserved_part(path) if windows else None
    if device is not None:
        raise RigctlError(
            f"{device!r} is a device on Windows, in every folder",
            where=Location(path),
            expected="another name",
        )


def _require_outside_runs(path: Path) -> None:
    run = containing_run(path)
    if run is not None:
        raise RigctlError(
            "nothing is written into a run: what was recorded stays as it is",
            where=Location(path),
            expected=f"a path outside {run}",
        )


def _require_no_file(folder: Path) -> None:
    """Refuse a folder that cannot be made because it or one above it is a file."""
    for there in (folder, *folder.parents):
        if there.is_dir():
            return
        if there.exists():
            raise RigctlError("a file is there", where=Location(there), expected="the name of a folder")


def containing_run(path: Path) -> Path | None:
    """Return the folder of the run that contains a path, following symbolic links; None if there is none."""
    real = path.resolve()
    for folder in (real, *real.parents):
        if (folder / run_json.NAME).is_file() or (folder / log.NAME).is_file():
            return folder
    return None


def _head(path: Path) -> bytes:
    try:
        with open(path, "rb", opener=regular) as file:
            return file.read(_HEAD)
    except OSError:
        return b""
