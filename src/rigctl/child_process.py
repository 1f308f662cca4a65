"""Other processes of this Python, which import nothing from the folder in which they work.

A project may come from a stranger, and `python -m` would look for `rigctl` and its libraries first in the
working folder: a file `rigctl.py` there would be executed with the user's rights.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

#: the environment variable of Python's option ``-P``; `multiprocessing` passes on no other sign of it
_SAFE_PATH: Final = "PYTHONSAFEPATH"
#: the folders that are searched first; a relative one would lead into the working folder of each process
_SEARCHED: Final = "PYTHONPATH"


def module_command(module: str, *arguments: str) -> list[str]:
    """The command line that runs a module of rigctl, or of its libraries, in another process.

    Its output is UTF-8, as whoever reads it expects: on Windows a pipe would have the code page of the user.
    """
    return [sys.executable, "-P", "-X", "utf8", "-m", module, *arguments]


def isolate_children() -> None:
    """Make all processes that this one starts import nothing from their working folder."""
    os.environ.update(_isolation())


@contextmanager
def isolated_children(**variables: str) -> Iterator[None]:
    """Do so for the processes started meanwhile, in other people's programs; with other `variables` too."""
    changed = {**_isolation(), **variables}
    before = {name: os.environ.get(name) for name in changed}
    os.environ.update(changed)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def leave_out_working_folder() -> None:
    """Remove the working folder, with which `python -m` begins the list of folders that are searched."""
    if not sys.flags.safe_path and sys.path and sys.path[0] == os.getcwd():  # noqa: PTH109 - pathlib is imported later
        del sys.path[0]


def own_stdin() -> int:
    """A descriptor of stdin for this process alone; stdin itself is nothing from then on.

    For a process that reads its stdin in a thread. On Windows each library with an extension asks at its
    import what stdin is, and would wait there for the end of the read, as would each process that is started.
    """
    own = os.dup(0)
    nothing = os.open(os.devnull, os.O_RDWR)
    os.dup2(nothing, 0)
    os.close(nothing)
    return own


def _isolation() -> dict[str, str]:
    searched = os.environ.get(_SEARCHED)
    if searched is None:
        return {_SAFE_PATH: "1"}
    # an empty entry, as 'PYTHONPATH=$PYTHONPATH:/folder' leaves it, means the working folder
    folders = [os.path.abspath(folder) for folder in searched.split(os.pathsep) if folder]  # noqa: PTH100
    return {_SAFE_PATH: "1", _SEARCHED: os.pathsep.join(folders)}
