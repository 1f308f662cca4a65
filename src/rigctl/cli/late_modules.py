"""Modules that SciPy loads and no command uses, loaded when something of them is asked for.

SciPy takes over all public names of NumPy, and with them its compiler of Fortran and its help for tests, and
what these need: 0.1 s of processor of every command that asks SciPy for a distribution.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec, PathFinder
from importlib.util import LazyLoader
from types import ModuleType

_LATE = frozenset({"numpy.f2py", "numpy.testing"})


class _LateFinder:
    @staticmethod
    def find_spec(
        fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname not in _LATE:
            return None
        found = PathFinder.find_spec(fullname, path, target)
        if found is not None and found.loader is not None:
            found.loader = LazyLoader(found.loader)
        return found


def load_late() -> None:
    """For a process of `rigctl`'s own, before NumPy is imported; where it is already, nothing changes."""
    sys.meta_path.insert(0, _LateFinder())
