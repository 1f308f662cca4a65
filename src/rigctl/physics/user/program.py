"""A family defined by a Python file: the only case in which rigctl executes a user's code.

This is only done for files that the user names explicitly on the command line.
"""

from __future__ import annotations

import sys
import traceback
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType

from rigctl.errors import Location, RigctlError
from rigctl.physics.families import as_family
from rigctl.physics.family import ModelFamily

#: name that the file must define: a ModelFamily, or a function without arguments that returns one
ATTRIBUTE = "family"


def run_family_file(path: Path) -> ModelFamily:
    """Run a Python file and return the family that it defines as `family`.

    Raises
    ------
    RigctlError
        the file cannot be read or fails, with the line; or it defines no family.
    """
    path = path.absolute()  # as in the interpreter's tracebacks
    where = Location(path)
    module = _run(path)
    if not hasattr(module, ATTRIBUTE):
        raise RigctlError(
            f"the file defines no '{ATTRIBUTE}'",
            expected=f"'{ATTRIBUTE} = ModelFamily(...)', or a function '{ATTRIBUTE}()' that returns one",
            where=where,
        )
    try:
        return as_family(getattr(module, ATTRIBUTE), f"'{ATTRIBUTE}'")
    except RigctlError as error:
        raise error.at(where) from error.__cause__


def _run(path: Path) -> ModuleType:
    name = f"rigctl_family_{path.stem}"
    spec = spec_from_file_location(name, path)
    if spec is None or spec.loader is None or not path.is_file():
        raise RigctlError("there is no such Python file", value=path.as_posix())
    module = module_from_spec(spec)
    sys.modules[name] = module  # classes of the file are looked up there
    try:
        spec.loader.exec_module(module)
    except RigctlError as error:
        raise error.at(_line(path, error)) from error
    except (Exception, SystemExit) as problem:  # the user's file may fail in any way
        raise RigctlError(
            f"the file fails: {type(problem).__name__}: {problem}", where=_line(path, problem)
        ) from problem
    return module


def _line(path: Path, problem: BaseException) -> Location:
    """The line of the file that was being executed, or that is not valid Python."""
    if isinstance(problem, SyntaxError) and problem.filename == str(path):
        return Location(path, problem.lineno, problem.offset)
    frames = traceback.extract_tb(problem.__traceback__)
    lines = [frame.lineno for frame in frames if frame.filename == str(path)]
    return Location(path, lines[-1] if lines else None)
