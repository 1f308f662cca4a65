"""From a system of equations to machine code that integrates it."""

from __future__ import annotations

import ctypes
import inspect
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
_KERNELS = '''"""Made by rigctl: the kernels, compiled; deleted and made again at will."""

from numba import njit

from rigctl.engine.kernels import record, step
from rigctl.engine.kernels.calling import OPTIONS
from rigctl.engine.kernels.signatures import RECORD, STEP
'''
_KERNEL_FUNCTION = """

@njit({signature}, cache=True, **OPTIONS)
def {name}({arguments}):
    return {module}.{name}({arguments})
"""


@dataclass(frozen=True)
class CompiledSystem:
    """A system with its machine code.

    Pickling it sends the equations alone; the other side finds or makes its own machine code.

    Attributes
    ----------
    system: the equations.
    source: the straight-line code it was made from; ``source.digest`` names the model.
    addresses: of the model's functions, in the order of `source.ARGUMENTS`.
    integrate_record, step_to: the compiled kernels of `kernels.record` and `kernels.step`.
    """

    system: System
    source: Source
    addresses: Integers = field(repr=False)
    integrate_record: Callable[..., Any] = field(repr=False)
    step_to: Callable[..., Any] = field(repr=False)

    def __reduce__(self) -> tuple[Callable[[System], CompiledSystem], tuple[System]]:
        return compile_system, (self.system,)


def compile_system(system: System, *, progress: Progress | None = None) -> CompiledSystem:
    """Compile `system`, or fetch its machine code from the cache.

    Takes some tenths of a second for a new model, less for a known one. The first model after installation
    also compiles the kernels, which takes some seconds; `progress` is told so.
    """
    kernels = _load_kernels(progress)
    source = source_of(system)
    model = load_compiled("model", {"compiled.py": _MODEL, "straight_line.txt": source.text})
    addresses = np.zeros(len(ARGUMENTS), dtype=np.int64)
    model.addresses.ctypes(addresses.ctypes.data_as(ctypes.POINTER(ctypes.c_int64)))
    return CompiledSystem(system, source, addresses, kernels.integrate_record, kernels.step_to)


def _load_kernels(progress: Progress | None) -> Any:
    from rigctl.engine.kernels.record import integrate_record
    from rigctl.engine.kernels.step import step_to

    text = _KERNELS + ("# with bounds checked\n" if width() else "")
    for module, signature, kernel in (("record", "RECORD", integrate_record), ("step", "STEP", step_to)):
        arguments = ", ".join(inspect.signature(kernel.py_func).parameters)
        text += _KERNEL_FUNCTION.format(
            signature=signature, name=kernel.__name__, module=module, arguments=arguments
        )

    def announce() -> None:
        if progress is not None:
            progress("Compiling the integrator, once for this installation (about 15 s)")

    return load_compiled("kernels", {"compiled.py": text}, before_compiling=announce)
