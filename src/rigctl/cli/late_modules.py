"""Lazy loading of modules that SciPy imports and no command uses.

SciPy imports all public names of NumPy, and with them numpy.f2py, numpy.testing and their dependencies: 0.1 s
of CPU time of every command that uses a distribution of SciPy.
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
        spec = PathFinder.find_spec(fullname, path, target)
        if spec is not None and spec.loader is not None:
            spec.loader = LazyLoader(spec.loader)
        return spec


def load_late() -> None:
    """Install lazy loading in a process of `rigctl`; has no effect once NumPy has been imported."""
    sys.meta_path.insert(0, _LateFinder())
