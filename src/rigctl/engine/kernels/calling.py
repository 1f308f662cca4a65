"""Pointers, and calls of the model's functions through their addresses, in compiled code.

The kernels work on plain pointers: numba counts the references to every array and every view of one, which
took more time than the arithmetic of a step. The arrays behind them belong to the Python caller, which holds
them while a kernel runs.
"""

from __future__ import annotations

import inspect
from collections.abc import Sequence
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numba.np.arrayobj import make_array, populate_array

from rigctl.engine.guards import width
from rigctl.engine.kernels.sizes import WORDS

#: index of each function in the array of addresses
RHS, RHS_JACOBIAN, RHS_TANGENT, OUTPUTS, OUTPUTS_TANGENT, DELAYS, DELAYS_TANGENT, FACTORISE, SOLVE = range(9)

#: compiler options of all kernels: division by zero gives inf, the interpreter lock is released, and
#: indices of arrays are checked when `engine.guards` are on
OPTIONS: dict[str, Any] = {"error_model": "numpy", "nogil": True, "boundscheck": width() > 0}


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


def _array_at(dtype: Any, dimensions: int) -> Any:
    """A compiled function ``array(words, number)``: the array that they describe, see `sizes.WORDS`."""
    kind = types.Array(dtype, dimensions, "C")

    def generate(_typing: Any, words: Any, number: Any) -> Any:
        def build(context: Any, builder: Any, _signature: Any, args: Sequence[Any]) -> Any:
            word = ir.IntType(64)

            def described(index: int) -> Any:
                first = builder.mul(args[1], ir.Constant(word, WORDS))
                return builder.load(builder.gep(args[0], [builder.add(first, ir.Constant(word, index))]))

            shape = [described(1 + axis) for axis in range(dimensions)]
            strides = [ir.Constant(word, 8)]
            for length in reversed(shape[1:]):
                strides.insert(0, builder.mul(strides[0], length))
            array = make_array(kind)(context, builder)
            data = builder.inttoptr(described(0), array.data.type)
            populate_array(array, data, shape, strides, ir.Constant(word, 8), None)
            return array._getvalue()  # noqa: SLF001 - numba's way to hand out a structure

        return kind(words, number), build

    # numba reads from the signature how many arguments the call takes
    generate.__signature__ = inspect.Signature(  # type: ignore[attr-defined]
        [
            inspect.Parameter(name, inspect.Parameter.POSITIONAL_OR_KEYWORD)
            for name in ("typingctx", "words", "number")
        ]
    )
    return intrinsic(generate)


floats_1 = _array_at(types.float64, 1)
floats_2 = _array_at(types.float64, 2)
floats_3 = _array_at(types.float64, 3)
integers_1 = _array_at(types.int64, 1)
integers_2 = _array_at(types.int64, 2)


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
