"""Straight-line code handed to LLVM, past the compiler's Python front end.

numba spends most of its time working out the types of Python statements; here every value is a double, so
each line becomes one instruction. It makes the first use of a model about ten times faster (see
docs/decisions) and the machine code is the same.
"""

from __future__ import annotations

import inspect
import math
import operator
from collections.abc import Sequence
from fractions import Fraction
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from rigctl.engine.source import ARGUMENTS

#: of `addresses`: a pointer to as many integers as there are functions
SIGNATURE: Any = types.void(types.CPointer(types.int64))  # type: ignore[no-untyped-call]

_BINARY = {"+": "fadd", "-": "fsub", "*": "fmul"}


def addresses_of(text: str) -> Any:
    """What writes the addresses of the functions of the straight-line code `text`, for compiled code to call.

    They are compiled with it, as one module: each by itself would go through the compiler's front end, which
    takes longer than their machine code.
    """

    def generate(_typing: Any, addresses: Any) -> Any:
        def build(context: Any, builder: Any, _signature: Any, args: Sequence[Any]) -> Any:
            for index, name in enumerate(ARGUMENTS):
                function = _function(context, builder, text, name)
                place = builder.gep(args[0], [ir.Constant(ir.IntType(64), index)])
                builder.store(builder.ptrtoint(function, ir.IntType(64)), place)
            return context.get_dummy_value()

        return types.void(addresses), build

    # numba reads from the signature how many arguments the call takes
    generate.__signature__ = inspect.Signature(  # type: ignore[attr-defined]
        [
            inspect.Parameter(name, inspect.Parameter.POSITIONAL_OR_KEYWORD)
            for name in ("typingctx", "addresses")
        ]
    )
    return intrinsic(generate)


def _function(context: Any, builder: Any, text: str, name: str) -> ir.Function:
    """The function `name` of the code, in the module of `builder`; it takes a pointer for each array."""
    doubles = [ir.DoubleType().as_pointer()] * len(ARGUMENTS[name])
    module = builder.module
    function = ir.Function(module, ir.FunctionType(ir.VoidType(), doubles), module.get_unique_name(name))
    function.linkage = "internal"
    within = ir.IRBuilder(function.append_basic_block("entry"))
    _Emitter(context, within, dict(zip(ARGUMENTS[name], function.args, strict=True))).emit(
        _lines_of(text, name)
    )
    within.ret_void()
    return function


def _lines_of(text: str, function: str) -> list[list[str]]:
    start = text.index(f"function {function} ")
    block = text[start : text.index("\nend\n", start)]
    return [line.split() for line in block.split("\n")[1:]]


class _Emitter:
    """Writes instructions with `builder`; the arrays are pointers to doubles."""

    def __init__(self, context: Any, builder: Any, arrays: dict[str, Any]) -> None:
        self.context = context
        self.builder = builder
        self.arrays = arrays
        self.values: list[Any] = []
        self.inverses: dict[int, Any] = {}

    def emit(self, lines: Sequence[Sequence[str]]) -> None:
        for number, operation, *args in lines:
            if number == "store":
                index, value = args
                self.builder.store(self.values[int(value)], self._place(operation, index))
            else:
                self.values.append(self._value(operation, args))

    def _value(self, operation: str, args: Sequence[str]) -> Any:
        if operation == "load":
            return self.builder.load(self._place(*args))
        if operation == "constant":
            return self._constant(float(args[0]))
        first = self.values[int(args[0])]
        if operation in _BINARY:
            return getattr(self.builder, _BINARY[operation])(first, self.values[int(args[1])])
        if operation == "/":
            return self.builder.fmul(first, self._inverse(int(args[1])))
        if operation == "negative":
            return self.builder.fneg(first)
        if operation == "larger":  # of the two; the second one where the first is not a number
            second = self.values[int(args[1])]
            return self.builder.select(self.builder.fcmp_ordered(">", first, second), first, second)
        if operation == "beyond":  # 1 where the first is larger or either is not a number, else 0
            more = self.builder.fcmp_unordered(">", first, self.values[int(args[1])])
            return self.builder.uitofp(more, ir.DoubleType())
        if operation == "power":
            return self._power(first, args[1])
        return self._call(operation, first)

    def _inverse(self, number: int) -> Any:
        """1 / value, once for each divisor: derivatives divide by the same few over and over.

        Every division is written so, or a term that is added at its null could change the last bit.
        """
        if number not in self.inverses:
            self.inverses[number] = self.builder.fdiv(self._constant(1.0), self.values[number])
        return self.inverses[number]

    def _power(self, base: Any, exponent: str) -> Any:
        """Products and roots where the exponent is a whole or a half number, else the library's pow."""
        if "." in exponent or "e" in exponent:
            double = types.float64
            function = self.context.get_function(operator.pow, double(double, double))
            return function(self.builder, [base, self._constant(float(exponent))])
        fraction = Fraction(exponent)
        if fraction.denominator == 2:
            base = self._call("sqrt", base)
        raised = self._whole_power(base, abs(fraction.numerator))
        return raised if fraction > 0 else self.builder.fdiv(self._constant(1.0), raised)

    def _whole_power(self, base: Any, exponent: int) -> Any:
        result = None
        while exponent:
            if exponent & 1:
                result = base if result is None else self.builder.fmul(result, base)
            exponent >>= 1
            if exponent:
                base = self.builder.fmul(base, base)
        return result

    def _call(self, name: str, argument: Any) -> Any:
        function = self.context.get_function(getattr(math, name), types.float64(types.float64))
        return function(self.builder, [argument])

    def _place(self, array: str, index: str) -> Any:
        return self.builder.gep(self.arrays[array], [ir.Constant(ir.IntType(64), int(index))])

    def _constant(self, value: float) -> Any:
        return ir.Constant(ir.DoubleType(), value)
