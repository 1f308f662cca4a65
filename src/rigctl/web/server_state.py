"""State shared by the parts of one server."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Final

from rigctl.errors import ExitCode, RigctlError
from rigctl.project import MARKER, Project, find_project
from rigctl.web.jobs import Jobs

if TYPE_CHECKING:
    from starlette.routing import BaseRoute

#: bytes of the longest message of a page through a socket: a workbench's state of thousands of parameters
LONGEST_MESSAGE: Final = 1 << 19


@dataclass
class Site:
    """One project in a browser.

    Parameters
    ----------
    project: its folder, and that of its runs.
    jobs: background jobs.
    at_end: called when the server ends.
    """

    project: Project
    jobs: Jobs
    at_end: list[Callable[[], None]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._read = self._written()

    def refresh(self) -> None:
        """Read ``rigctl.toml`` if it has changed since it was read, as each command reads it anew."""
        written = self._written()
        if written not in (None, self._read):
            with suppress(RigctlError):  # half written: the next call reads it
                self.project = find_project(self.project.root)
                self._read = written

    def _written(self) -> tuple[int, int] | None:
        """When ``rigctl.toml`` was written, and its length; None without the file."""
        try:
            found = (self.project.root / MARKER).stat()
        except OSError:
            return None
        return found.st_mtime_ns, found.st_size

    def require_project(self) -> Path:
        """The project's folder.

        Raises
        ------
        RigctlError
            it is gone.
        """
        root = self.project.root
        if not root.is_dir():
            raise RigctlError(
                "the project's folder is missing",
                value=root.as_posix(),
                hint="Nothing can be read or started until it is back; this page then continues by itself",
                exit_code=ExitCode.FAILED,
            )
        return root


@dataclass(frozen=True)
class PagePart:
    """One entry of the navigation.

    Parameters
    ----------
    name: its path is ``/name``, its script ``assets/name.js``, and its routes begin with ``/api/name/``.
    title: in the navigation.
    about: one line for the page's description.
    routes: makes its routes, from `rigctl.web.request_handling.get` and `post`.
    """

    name: str
    title: str
    about: str
    routes: Callable[[Site], Sequence[BaseRoute]]
