"""Compiles the Python source of a kernel to portable LLVM IR, with numba."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any

import llvmlite.binding as llvm
from numba import types
from numba.core import config
from numba.core.compiler import Flags, compile_extra
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import cpu_target

from rigctl.engine.kernels.calling import OPTIONS
from rigctl.engine.kernels.portable import SYMBOL
from rigctl.engine.machine_code import host

_FUNCTIONS = {
    "record": "integrate_record",
    "step": "step_to",
    "variances": "most_likely",
    "likelihood": "restricted",
}
#: lines that are specific to one computer, and addresses that are valid in one process only
_LOCAL = re.compile(r"^(?:target (?:datalayout|triple)|source_filename) = .*\n", re.MULTILINE)
_OF_PROCESS = re.compile(r"inttoptr \(i64 \d{4,} ")


def text_of(module: str) -> str:
    """LLVM IR of the kernel in `module` of this package, for any processor with 64-bit pointers.

    It is simplified but not optimised: vectorisation and inlining depend on the target computer.
    """
    function: Any = getattr(import_module(f"{__package__}.{module}"), _FUNCTIONS[module])
    flags: Any = Flags()
    flags.no_cpython_wrapper = flags.no_cfunc_wrapper = flags.no_compile = True
    flags.error_model, flags.boundscheck = OPTIONS["error_model"], OPTIONS["boundscheck"]
    given = (types.CPointer(types.int64),)
    with global_compiler_lock, _unoptimised():
        made: Any = compile_extra(
            cpu_target.typing_context, cpu_target.target_context, function, given, types.void, flags, {}
        )
        made.library.finalize()
        whole = llvm.parse_assembly(made.library.get_llvm_str())
    whole.get_function(made.fndesc.llvm_func_name).name = SYMBOL
    _simplify(whole)
    text = _LOCAL.sub("", str(whole))
    if not flags.boundscheck and _OF_PROCESS.search(text):
        raise RuntimeError(f"the kernel in {module} uses an object of the process that compiled it")
    return text


@contextmanager
def _unoptimised() -> Iterator[None]:
    """Switch off numba's optimisation, which would be repeated for each function with all its callers."""
    settings: Any = config
    before = settings.OPT, settings.LOOP_VECTORIZE, settings.SLP_VECTORIZE
    settings.OPT, settings.LOOP_VECTORIZE, settings.SLP_VECTORIZE = type(settings.OPT)(0), 0, 0
    try:
        yield
    finally:
        settings.OPT, settings.LOOP_VECTORIZE, settings.SLP_VECTORIZE = before


def _simplify(module: Any) -> None:
    """Promote values to registers and remove dead code, which leaves a seventh of the text."""
    for function in module.functions:
        if not function.is_declaration and function.name != SYMBOL:
            function.linkage = llvm.Linkage.internal
    for variable in module.global_variables:
        if not variable.is_declaration:
            variable.linkage = llvm.Linkage.internal
    passes = llvm.create_new_module_pass_manager()
    passes.add_sroa_pass()
    passes.add_instruction_combine_pass()
    passes.add_simplify_cfg_pass()
    passes.add_aggressive_dce_pass()
    passes.add_global_opt_pass()
    passes.add_global_dead_code_eliminate_pass()
    passes.run(module, llvm.create_pass_builder(host(), llvm.create_pipeline_tuning_options(speed_level=1)))
