"""An empty folder in a browser: ``rigctl init`` by a click."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from rigctl.errors import RigctlError
from rigctl.project import MARKER
from rigctl.web.request_handling import PageRequest

if TYPE_CHECKING:
    from rigctl.web.server_state import Site

_HOLDS: Final = (MARKER, "rigs", "models", "procedures", "runs", "families")


def is_empty(site: Site) -> bool:
    """Whether the folder contains no part of a project."""
    root = site.project.root
    return root.is_dir() and not any((root / name).exists() for name in _HOLDS)


def fill(site: Site, request: PageRequest) -> dict[str, Any]:
    """Start a project in the folder: ``rigctl init``, or with ``--minimal`` an empty one.

    Raises
    ------
    RigctlError
        the folder holds a project.
    """
    root = site.require_project()
    if not is_empty(site):
        raise RigctlError("this folder holds a project already", value=root.as_posix())
    minimal = ["--minimal"] if request.body.get("minimal") is True else []
    return site.jobs.start_command("New project", ["init", *minimal]).document()
