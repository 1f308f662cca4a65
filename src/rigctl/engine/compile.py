"""From a system of equations to machine code that integrates it.

In: a `System`. Out: a `CompiledSystem`, with the addresses of the model's functions and the kernels that
call them. The two are compiled apart: a kernel (integration, step control, sensitivities) once for an
installation, a model for each set of equations, so that another effect costs tenths of a second and not
the seconds of an integrator.

Both are kept in the user's cache by the hash of what they depend on. Another process is sent the
equations alone, and loads or compiles its own code. A system of which an FMU computes a part has no
functions; it is two compiled systems around the program (`Cascade`).
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.engine.cache import load_compiled
from rigctl.engine.differences import Step
from rigctl.engine.foreign_parts import parts_of
from rigctl.engine.guards import width
from rigctl.engine.kept_derivatives import Kept
from rigctl.engine.kernels.sizes import WORDS
from rigctl.engine.machine_code import MachineCode, compiled
from rigctl.engine.source import ARGUMENTS, Source, source_of
from rigctl.engine.straight_line import module_of
from rigctl.engine.system import Foreign, System
from rigctl.errors import ExitCode, RigctlError

Integers = NDArray[np.int64]

#: called with a description of a long operation
Progress = Callable[[str], None]

#: a compiled integrator, called with the output of `words_of` for its arrays
Kernel = Callable[[Integers], None]


@dataclass(frozen=True)
class CompiledSystem:
    """A system with its machine code.

    Only the equations are pickled; the receiving process loads or compiles its own machine code.

    Attributes
    ----------
    system: the equations.
    source: the straight-line code it was made from; ``source.digest`` names the model.
    addresses: of the model's functions, in the order of `source.ARGUMENTS`.
    steps: number of steps in the last integration of each record, by name: an estimate of its cost.
    cascade: the parts of a system that another program computes in part; it has no functions of its own.
    """

    system: System
    source: Source
    addresses: Integers = field(repr=False)
    steps: dict[str, int] = field(default_factory=dict, repr=False, compare=False)
    cascade: Cascade | None = field(default=None, repr=False)

    @property
    def integrate_record(self) -> Kernel:
        """The compiled kernel of `kernels.record`, which takes the words of its arrays."""
        return kernel("record", width() > 0)

    @property
    def step_to(self) -> Kernel:
        """The compiled kernel of `kernels.step`, likewise."""
        return kernel("step", width() > 0)

    def accuracy(self, columns: Iterable[str]) -> float:
        """The relative accuracy of the derivatives by these parameters, as far as they have been made; 0 if
        they are exact."""
        steps = {} if self.cascade is None else self.cascade.steps
        return max((steps[name].apart for name in columns if name in steps), default=0.0)

    def __reduce__(self) -> tuple[Callable[..., CompiledSystem], tuple[Any, ...]]:
        if self.cascade is not None:
            return _cascade_again, (self.system, self.cascade.steps, self.cascade.sizes)
        return compile_system, (self.system,)


@dataclass(frozen=True)
class Cascade:
    """A system in three parts: what a program is given, the program, what is read of it.

    Attributes
    ----------
    commands: the equations whose outputs are the program's inputs.
    readings: those whose inputs are the system's, and the rates of the program's outputs.
    steps: how each column is differenced; `sizes` the usual step of those that act on what the program is
        given.
    kept: the last derivatives of each record, by its name.
    """

    commands: CompiledSystem
    readings: CompiledSystem
    steps: dict[str, Step]
    sizes: dict[str, float]
    kept: dict[str, Kept] = field(default_factory=dict, repr=False)


def _cascade_again(system: System, steps: dict[str, Step], sizes: dict[str, float]) -> CompiledSystem:
    """A compiled system that another process sends: it has asked whether the program may run."""
    assert system.foreign is not None  # noqa: S101 - it has a cascade
    system.foreign.program.allow()
    compiled = compile_system(system)
    assert compiled.cascade is not None  # noqa: S101
    compiled.cascade.steps.update(steps)
    compiled.cascade.sizes.update(sizes)
    return compiled


def compile_system(
    system: System, *, stepping: bool = False, progress: Progress | None = None
) -> CompiledSystem:
    """Compile `system`, or fetch its machine code from the cache.

    Takes some tenths of a second for a new model, less for a known one. The first model after installation
    also compiles the kernel that integrates whole records, or with `stepping` the one that advances step by
    step; that takes some seconds, and is reported to `progress`. The other kernel is compiled when it is
    first used.
    """
    if system.foreign is not None:
        return _compile_cascade(system, system.foreign, stepping=stepping, progress=progress)
    # the kernel first, so that a user who waits for it is told why; then the model, whose code is its key in
    # the cache
    kernel("step" if stepping else "record", width() > 0, progress)
    source = source_of(system)
    model = load_compiled(
        "model", source.text, lambda: compiled(module_of(source.text), ARGUMENTS, vectors=False)
    )
    addresses = np.array([model[name] for name in ARGUMENTS], dtype=np.int64)
    return CompiledSystem(system, source, addresses)


def _compile_cascade(
    system: System, foreign: Foreign, *, stepping: bool, progress: Progress | None
) -> CompiledSystem:
    foreign.program.require_allowed()
    if stepping:
        raise RigctlError(
            f"what {foreign.program.noun} computes cannot be a simulated bench, on which procedures run",
            value=foreign.program.name,
        )
    commands, readings = (compile_system(one, progress=progress) for one in parts_of(system, foreign))
    # the text of the commands does not say which of its outputs are added to which parameters
    added = [f"{one.parameter} in {one.low!r} to {one.high!r}" for one in foreign.added]
    text = "\n".join([commands.source.text, readings.source.text, repr(foreign.program), *added])
    source = Source(text, (), (), ())
    return CompiledSystem(
        system, source, np.empty(0, dtype=np.int64), cascade=Cascade(commands, readings, {}, {})
    )


#: by module of the kernel, and whether its bounds are checked
_kernels: dict[tuple[str, bool], Kernel] = {}


def kernel(module: str, checked: bool, progress: Progress | None = None) -> Kernel:
    """The compiled kernel in a `module` of `engine.kernels`; `checked` checks the bounds of its arrays.

    They are compiled separately, because most processes need only some and compilation takes seconds.
    """

    def announce() -> None:
        if progress is not None:
            progress("Compiling the integrator, once for this installation (a few seconds)")

    if (module, checked) not in _kernels:
        source = f"{module}, bounds checked" if checked else module
        addresses = load_compiled(
            f"kernel-{module}", source, lambda: _kernel_code(module, checked), before_compiling=announce
        )
        (address,) = addresses.values()
        _kernels[module, checked] = _caller(address)
    return _kernels[module, checked]


def _kernel_code(module: str, checked: bool) -> MachineCode:
    from rigctl.engine.kernels.portable import SYMBOL, kept_text, made_text

    shipped = None if checked else kept_text(module)
    if shipped is not None:
        with suppress(RuntimeError):  # LLVM cannot read the file of another version
            return compiled(shipped, [SYMBOL], vectors=True)
    return compiled(made_text(module), [SYMBOL], vectors=True)


def _caller(address: int) -> Kernel:
    """The kernel as a Python function that releases the interpreter lock; see `kernels.portable.SYMBOL`."""
    pointer = ctypes.c_void_p
    function = ctypes.CFUNCTYPE(ctypes.c_int32, pointer, pointer, pointer)(address)

    def call(words: Integers) -> None:
        result, error = ctypes.c_void_p(), ctypes.c_void_p()
        if function(ctypes.byref(result), ctypes.byref(error), words.ctypes.data):
            raise RigctlError("a kernel went past the end of an array", exit_code=ExitCode.FAILED)

    return call


def words_of(*arrays: NDArray[Any]) -> Integers:
    """The addresses and lengths of `arrays`, in a kernel's format; the arrays must be kept alive while it
    runs.

    Raises
    ------
    TypeError
        an array is not of a type for kernels: contiguous doubles or 64-bit integers.
    """
    words: list[int] = []
    for array in arrays:
        if array.itemsize != 8 or array.dtype.kind not in "fi" or not array.flags.c_contiguous:
            raise TypeError(f"a kernel cannot take an array of {array.dtype} with strides {array.strides}")
        words += array.ctypes.data, *array.shape, *_NO_AXIS[array.ndim]
    return np.array(words, dtype=np.int64)


#: padding of an array's words, by its number of axes
_NO_AXIS = [(0,) * (WORDS - 1 - axes) for axes in range(WORDS)]
