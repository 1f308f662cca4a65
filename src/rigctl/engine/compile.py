"""From a system of equations to machine code that integrates it."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.engine.cache import load_compiled
from rigctl.engine.guards import width
from rigctl.engine.source import ARGUMENTS, Source, source_of
from rigctl.engine.system import System

Integers = NDArray[np.int64]

#: told what takes long, in words for a user
Progress = Callable[[str], None]

_MODEL = '''"""Made by rigctl from a system of equations; deleted and made again at will."""

from pathlib import Path

from numba import cfunc

from rigctl.engine.straight_line import SIGNATURE, addresses_of

_addresses = addresses_of((Path(__file__).parent / "straight_line.txt").read_text(encoding="utf-8"))


@cfunc(SIGNATURE, cache=True, error_model="numpy")
def addresses(into):
    _addresses(into)
'''
_KERNEL = '''"""Made by rigctl: a kernel, compiled; deleted and made again at will."""

from numba import njit

from rigctl.engine.kernels.calling import OPTIONS, moved_to
from rigctl.engine.kernels.{module} import {name} as written
from rigctl.engine.kernels.signatures import {signature}

{name} = njit({signature}, cache=True, **OPTIONS)(moved_to(written.py_func, __name__, __file__))
'''


@dataclass(frozen=True)
class CompiledSystem:
    """A system with its machine code.

    Pickling it sends the equations alone; the other side finds or makes its own machine code.

    Attributes
    ----------
    system: the equations.
    source: the straight-line code it was made from; ``source.digest`` names the model.
    addresses: of the model's functions, in the order of `source.ARGUMENTS`.
    """

    system: System
    source: Source
    addresses: Integers = field(repr=False)

    @property
    def integrate_record(self) -> Callable[..., Any]:
        """The compiled kernel of `kernels.record`."""
        return _kernel("record", width() > 0)

    @property
    def step_to(self) -> Callable[..., Any]:
        """The compiled kernel of `kernels.step`."""
        return _kernel("step", width() > 0)

    def __reduce__(self) -> tuple[Callable[[System], CompiledSystem], tuple[System]]:
        return compile_system, (self.system,)


def compile_system(
    system: System, *, stepping: bool = False, progress: Progress | None = None
) -> CompiledSystem:
    """Compile `system`, or fetch its machine code from the cache.

    Takes some tenths of a second for a new model, less for a known one. The first model after installation
    also compiles the kernel that integrates whole records, or with `stepping` the one that goes on step by
    step; that takes some seconds, and `progress` is told so. The other one is compiled when it is first used.
    """
    _kernel("step" if stepping else "record", width() > 0, progress)
    source = source_of(system)
    model = load_compiled("model", {"compiled.py": _MODEL, "straight_line.txt": source.text})
    addresses = np.zeros(len(ARGUMENTS), dtype=np.int64)
    model.addresses.ctypes(addresses.ctypes.data_as(ctypes.POINTER(ctypes.c_int64)))
    return CompiledSystem(system, source, addresses)


#: by module of the kernel, and whether its bounds are checked
_loaded: dict[tuple[str, bool], Callable[..., Any]] = {}
_NAMES = {"record": ("integrate_record", "RECORD"), "step": ("step_to", "STEP")}


def _kernel(module: str, checked: bool, progress: Progress | None = None) -> Callable[..., Any]:
    """A compiled kernel. Each is a module of its own: what integrates records never steps, and a compilation
    takes seconds.
    """

    def announce() -> None:
        if progress is not None:
            progress("Compiling the integrator, once for this installation (about 10 s)")

    if (module, checked) not in _loaded:
        name, signature = _NAMES[module]
        text = _KERNEL.format(module=module, name=name, signature=signature)
        text += "# with bounds checked\n" if checked else ""
        made = load_compiled(f"kernel-{module}", {"compiled.py": text}, before_compiling=announce)
        _loaded[module, checked] = getattr(made, name)
    return _loaded[module, checked]
