"""Kernels to machine code: numba writes it, and no process that finds it in the cache needs numba again."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from llvmlite.binding import parse_assembly
from numba import types
from numba.core.compiler import Flags, compile_extra
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import cpu_target

from rigctl.engine.kernels.calling import OPTIONS
from rigctl.engine.machine_code import MachineCode, emitted

#: of the one function in the machine code of a kernel: ``int32 kernel(void *, void **, int64 *words)``. The
#: first two are numba's, for a result and for an error; another number than 0 is returned where there is one.
SYMBOL = "kernel"
_KERNELS = {"record": "integrate_record", "step": "step_to"}


def kernel_code(module: str) -> MachineCode:
    """The machine code of the kernel in `module` of this package."""
    function: Any = getattr(import_module(f"{__package__}.{module}"), _KERNELS[module])
    flags: Any = Flags()
    flags.no_cpython_wrapper = flags.no_cfunc_wrapper = flags.no_compile = True
    flags.error_model, flags.boundscheck = OPTIONS["error_model"], OPTIONS["boundscheck"]
    given = (types.CPointer(types.int64),)
    with global_compiler_lock:
        made: Any = compile_extra(
            cpu_target.typing_context, cpu_target.target_context, function, given, types.void, flags, {}
        )
        made.library.finalize()
        final = parse_assembly(made.library.get_llvm_str())
    final.get_function(made.fndesc.llvm_func_name).name = SYMBOL
    return emitted(final, [SYMBOL])
