"""Machine code as object files, which LLVM emits and loads without numba.

Importing and initialising numba takes half a second, mostly for a compiler that is not needed if all machine
code is in the cache. The cache therefore contains ordinary object files with C functions.
"""

from __future__ import annotations

import ctypes
import itertools
import sys
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from typing import Any

#: functions of the C library to which LLVM may lower its intrinsics
_LIBRARY = frozenset({"exp", "log", "pow", "sin", "cos", "memset", "memcpy", "memmove"})


@dataclass(frozen=True)
class MachineCode:
    """Compiled functions that are not in memory yet.

    Attributes
    ----------
    content: an object file for this processor.
    defines: the functions in it.
    needs: the external symbols that it calls.
    """

    content: bytes
    defines: tuple[str, ...]
    needs: tuple[str, ...]


def compiled(text: str, defines: Iterable[str], *, vectors: bool) -> MachineCode:
    """Optimise LLVM IR and compile its functions `defines` to machine code.

    Optimisations that change results are excluded: no reassociation, no fused multiply-add.

    Parameters
    ----------
    vectors: vectorise. In code without loops this takes longer than all other passes, with hardly any gain.
    """
    import llvmlite.binding as llvm

    machine = host()  # also initialises the target, which parsing requires
    module = llvm.parse_assembly(text)
    module.verify()
    module.triple, module.data_layout = llvm.get_process_triple(), str(machine.target_data)
    options = llvm.create_pipeline_tuning_options(speed_level=3)
    options.loop_vectorization = options.slp_vectorization = vectors
    builder = llvm.create_pass_builder(machine, options)
    builder.getModulePassManager().run(module, builder)
    return MachineCode(machine.emit_object(module), tuple(defines), tuple(sorted(set(_needs(module)))))


def _needs(module: Any) -> Iterable[str]:
    for function in module.functions:
        if not function.is_declaration:
            continue
        if not function.name.startswith("llvm."):
            yield function.name
        elif function.name.split(".")[1] in _LIBRARY:
            yield function.name.split(".")[1]
    for variable in module.global_variables:
        if variable.is_declaration:
            yield variable.name


def loaded(code: MachineCode) -> Mapping[str, int]:
    """The address of each function that `code` defines; it stays in memory as long as the process lives.

    Raises
    ------
    RuntimeError, OSError
        it is not machine code, lacks a function, or needs a symbol that cannot be resolved.
    """
    import llvmlite.binding as llvm

    library = llvm.JITLibraryBuilder().add_object_img(code.content).add_current_process()
    for name in code.needs:
        library.import_symbol(name, _address(name))
    for name in code.defines:
        library.export_symbol(name)
    tracker = library.link(_linker(), f"rigctl {next(_numbers)}")
    _libraries.append(tracker)
    return {name: tracker[name] for name in code.defines}


#: trackers of the loaded libraries; their functions are unloaded with them
_libraries: list[Any] = []
#: for unique library names, also of those that could not be linked
_numbers = itertools.count()


@cache
def _linker() -> Any:
    import llvmlite.binding as llvm

    return llvm.create_lljit_compiler(_machine(), suppress_errors=True)


def _address(name: str) -> int:
    """Address of a function of another library; of several copies, the one already loaded by this process."""
    import llvmlite.binding as llvm

    for library in _process():
        with suppress(ValueError):
            return ctypes.addressof(ctypes.c_char.in_dll(library, name))
    _provide_all()
    found = llvm.address_of_symbol(name)
    if not found:
        raise OSError(f"no library has the function {name}")
    return int(found)


@cache
def _process() -> list[ctypes.CDLL]:
    """The C library and Python."""
    return [ctypes.cdll.ucrtbase, ctypes.pythonapi] if sys.platform == "win32" else [ctypes.CDLL(None)]


@cache
def _provide_all() -> None:
    """Register numba's own functions, which kernels with bounds checks call on errors."""
    from numba.core.registry import cpu_target

    cpu_target.target_context.refresh()


@cache
def host() -> Any:
    """LLVM's target machine: this processor, with all its instruction-set extensions."""
    return _machine()


@cache
def _target() -> tuple[Any, str, str]:
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    features = llvm.get_host_cpu_features().flatten()
    return llvm.Target.from_default_triple(), llvm.get_host_cpu_name(), features


def _machine() -> Any:
    target, processor, features = _target()
    return target.create_target_machine(
        cpu=processor,
        features=features,
        opt=3,
        reloc="static" if target.name.startswith("x86") else "default",
        codemodel="jitdefault",
        jit=True,
    )
