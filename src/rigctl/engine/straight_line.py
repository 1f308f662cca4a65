"""Translation of straight-line code to LLVM IR, bypassing numba's front end.

numba spends most of its time on the inference of types; here every value is a double, so that each line
becomes one instruction. This makes the first use of a model about ten times as fast (see docs/decisions), and
the machine code is the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

from rigctl.engine.source import ARGUMENTS

_BINARY = {"+": "fadd", "-": "fsub", "*": "fmul"}
#: functions of one argument that are LLVM intrinsics; the others are those of the C library
_INTRINSIC = frozenset({"fabs", "sqrt", "exp", "log", "sin", "cos"})


def module_of(text: str) -> str:
    """The functions of the straight-line code `text` as LLVM IR; each takes one pointer per array."""
    from llvmlite import binding, ir

    module = ir.Module("straight_line")
    module.triple = binding.get_process_triple()
    for name in ARGUMENTS:
        _add_function(module, text, name)
    return str(module)


def _add_function(module: Any, text: str, name: str) -> None:
    from llvmlite import ir

    doubles = [ir.DoubleType().as_pointer()] * len(ARGUMENTS[name])
    function = ir.Function(module, ir.FunctionType(ir.VoidType(), doubles), name)
    within = ir.IRBuilder(function.append_basic_block("entry"))
    _Emitter(within, dict(zip(ARGUMENTS[name], function.args, strict=True))).emit(_lines_of(text, name))
    within.ret_void()


def _lines_of(text: str, function: str) -> list[list[str]]:
    start = text.index(f"function {function} ")
    block = text[start : text.index("\nend\n", start)]
    return [line.split() for line in block.split("\n")[1:]]


class _Emitter:
    """Writes instructions with `builder`; the arrays are pointers to doubles."""

    def __init__(self, builder: Any, arrays: dict[str, Any]) -> None:
        from llvmlite import ir

        self.ir = ir
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
            return self.builder.uitofp(more, self.ir.DoubleType())
        if operation == "power":
            return self._power(first, args[1])
        return self._call(operation, first)

    def _inverse(self, number: int) -> Any:
        """1 / value, computed once for each divisor, since derivatives divide by the same few many times.

        All divisions are written in this way; otherwise adding a term at its null could change the last bit.
        """
        if number not in self.inverses:
            self.inverses[number] = self.builder.fdiv(self._constant(1.0), self.values[number])
        return self.inverses[number]

    def _power(self, base: Any, exponent: str) -> Any:
        """Products and a square root for integer and half-integer exponents, else the C library's pow."""
        if "." in exponent or "e" in exponent:
            function = self.builder.module.declare_intrinsic("llvm.pow", [self.ir.DoubleType()])
            return self.builder.call(function, [base, self._constant(float(exponent))])
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
        double, module = self.ir.DoubleType(), self.builder.module
        if name in _INTRINSIC:
            function = module.declare_intrinsic(f"llvm.{name}", [double])
        else:
            function = module.globals.get(name)
            if function is None:
                function = self.ir.Function(module, self.ir.FunctionType(double, [double]), name)
                function.attributes.add("nounwind")
                function.attributes.add("readonly")
        return self.builder.call(function, [argument])

    def _place(self, array: str, index: str) -> Any:
        return self.builder.gep(self.arrays[array], [self.ir.Constant(self.ir.IntType(64), int(index))])

    def _constant(self, value: float) -> Any:
        return self.ir.Constant(self.ir.DoubleType(), value)
