"""How a designed procedure refers to the rig file of its runs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rigctl.dataset.run import Run
from rigctl.project import find_project
from rigctl.rig.rig import Rig


def rig_reference(runs: Sequence[Run], rig: Rig) -> str:
    """The path of the rig file as a procedure in the project names it; "" if the file no longer exists.

    A rig file outside the current project is named by its absolute path.
    """
    written = next((run.header.rig.path for run in runs if run.header.rig.path), "")
    path = Path(written) if written else rig.path
    if path is None or not path.is_file():
        return ""
    absolute = path.absolute()
    root = find_project(absolute.parent).root
    inside = root == find_project().root and absolute.is_relative_to(root)
    return (absolute.relative_to(root) if inside else absolute).as_posix()
