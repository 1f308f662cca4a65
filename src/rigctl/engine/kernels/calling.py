"""Pointers, and calls of the model's functions through their addresses, in compiled code.

The kernels work on plain pointers: numba counts the references to every array and every view of one, which
took more time than the arithmetic of a step. The arrays behind them belong to the Python caller, which holds
them while a kernel runs.
"""

from __future__ import annotations

import inspect
from collections.abc import Sequence
from types import FunctionType
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from rigctl.engine.guards import width

#: where the address of each function stands in the array of addresses
RHS, RHS_JACOBIAN, RHS_TANGENT, OUTPUTS, OUTPUTS_TANGENT, DELAYS, DELAYS_TANGENT, FACTORISE, SOLVE = range(9)

#: how every kernel is compiled: division by zero gives inf, other Python threads go on meanwhile, and
#: indices of arrays are checked when `engine.guards` are on
OPTIONS: dict[str, Any] = {"error_model": "numpy", "nogil": True, "boundscheck": width() > 0}


def moved_to(function: FunctionType, module: str, file: str) -> FunctionType:
    """The same function as one that stands in another module: numba keeps its machine code beside that file.

    A second function that called it would do as well, and take a sixth longer to compile.
    """
    code = function.__code__.replace(co_filename=file, co_firstlineno=1)
    copy = FunctionType(code, function.__globals__, function.__name__, function.__defaults__)
    copy.__module__ = module
    return copy


@intrinsic
def pointer_to(_typing, array):
    """A pointer to the first element of a contiguous array."""

    def build(context, builder, signature, args):
        return context.make_array(signature.args[0])(context, builder, args[0]).data

    return types.CPointer(array.dtype)(array), build


@intrinsic
def offset(_typing, pointer, count):
    """``pointer + count``, counted in elements."""

    def build(_context, builder, _signature, args):
        return builder.gep(args[0], [args[1]])

    return pointer(pointer, types.int64), build


def _caller(count: int) -> Any:
    """A compiled function ``call(address, pointer, ...)`` for a C function of `count` pointers to doubles."""
    names = ("typingctx", "address", *(f"pointer_{index}" for index in range(count)))

    def generate(_typing: Any, address: Any, *pointers: Any) -> Any:
        def build(context: Any, builder: Any, _signature: Any, args: Sequence[Any]) -> Any:
            doubles = ir.DoubleType().as_pointer()
            function = ir.FunctionType(ir.VoidType(), [doubles] * count).as_pointer()
            builder.call(builder.inttoptr(args[0], function), args[1:])
            return context.get_dummy_value()

        return types.void(address, *pointers), build

    # numba reads from the signature how many arguments the call takes
    generate.__signature__ = inspect.Signature(  # type: ignore[attr-defined]
        [inspect.Parameter(name, inspect.Parameter.POSITIONAL_OR_KEYWORD) for name in names]
    )
    return intrinsic(generate)


call_2 = _caller(2)
call_4 = _caller(4)
call_5 = _caller(5)
call_6 = _caller(6)
call_7 = _caller(7)
