"""Where a command may write what it makes: never into a run, and over products of its own kind alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from rigctl.dataset import log, run_json
from rigctl.errors import Location, RigctlError

#: how much of a file is looked at to tell what it is
_HEAD: Final = 4096
#: how figures begin: PNG, and SVG with or without an XML declaration
_FIGURES: Final = (b"\x89PNG\r\n\x1a\n", b"<svg", b"<?xml")


def is_page(head: bytes) -> bool:
    """Whether a file that begins so is a page of ours."""
    return b'<meta name="generator" content="rigctl ' in head


def is_figure(head: bytes) -> bool:
    """Whether a file that begins so is a figure."""
    return head.lstrip().startswith(_FIGURES)


def is_schema(head: bytes) -> bool:
    """Whether a file that begins so is a JSON Schema."""
    return head.lstrip().startswith(b"{") and b"$schema" in head


def is_designed(head: bytes) -> bool:
    """Whether a file that begins so is a procedure that was designed."""
    return head.startswith(b"# Written by 'rigctl design'")


def require_output(
    path: Path,
    *,
    replaces: Callable[[bytes], bool] | None = None,
    force: bool = False,
    option: str = "--force",
) -> None:
    """Refuse to write where something else would be lost.

    Parameters
    ----------
    replaces: tells from the first bytes of a file that is there whether it is an earlier product of the same
        kind, which is replaced without being asked; None where nothing is.
    force: replace any file but one of a run.
    option: how a user says so; empty where no option does.

    Raises
    ------
    RigctlError
        the path lies in a run's folder or is a folder, or another file is there.
    """
    run = containing_run(path)
    if run is not None:
        raise RigctlError(
            "nothing is written into a run: what was recorded stays as it is",
            where=Location(path),
            expected=f"a path outside {run}",
        )
    if path.is_dir():
        raise RigctlError("a folder is there", where=Location(path), expected="the name of a file")
    if not (path.exists() or path.is_symlink()) or force:
        return
    if replaces is None or not replaces(_head(path)):
        what = "the file is there already" if replaces is None else "a file of another kind is there already"
        raise RigctlError(
            what,
            where=Location(path),
            hint="Choose another name" + f"; '{option}' replaces it" * bool(option),
        )


def require_outputs(paths: Sequence[Path], *, replaces: Callable[[bytes], bool], force: bool = False) -> None:
    """`require_output` for several files."""
    for path in paths:
        require_output(path, replaces=replaces, force=force)


def containing_run(path: Path) -> Path | None:
    """The folder of the run that a path lies in, symbolic links followed; None where it lies in none."""
    real = path.resolve()
    for folder in (real, *real.parents):
        if (folder / run_json.NAME).is_file() or (folder / log.NAME).is_file():
            return folder
    return None


def _head(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            return file.read(_HEAD)
    except OSError:
        return b""
