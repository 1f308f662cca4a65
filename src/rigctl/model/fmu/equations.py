"""A system's straight-line code as C."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from typing import Final

from rigctl.engine.source import ARGUMENTS, source_of
from rigctl.engine.system import System

#: the functions that the slave calls, with the name of each in C
_FUNCTIONS: Final = {
    "rhs": "eq_rhs",
    "rhs_jacobian": "eq_rhs_jacobian",
    "outputs": "eq_outputs",
    "delays": "eq_delays",
}
#: arrays that a function writes
_WRITTEN: Final = ("value", "jacobian")
_OPERATORS: Final = ("+", "-", "*", "/")
#: scale of a state relative to which its error is controlled, for a tolerance of 1
_SCALE: Final = 1.0


def equations_header(system: System, guid: str, states: Sequence[float], inputs: Sequence[float]) -> str:
    """The file ``equations.h``: sizes, values at the start, and the functions.

    Parameters
    ----------
    states, inputs: at the start, SI, in the system's order.
    """
    sizes = {
        "STATES": len(system.states),
        "INPUTS": len(system.inputs),
        "PARAMETERS": len(system.parameters),
        "OUTPUTS": len(system.outputs),
    }
    lines = ["/* Written by rigctl from a model file. */"]
    lines += [f"#define {name} {size}" for name, size in sizes.items()]
    lines += [f"#define GUID {json.dumps(guid)}", "#define RELATIVE 1.0"]
    lines.append(_array("START_STATES", states))
    lines.append(_array("START_INPUTS", inputs))
    lines.append(_array("START_PARAMETERS", system.nominal))
    lines.append(_array("SCALES", [_SCALE * state.scale for state in system.states]))
    lines += _functions(source_of(system).text)
    lines += _input_delays(system)
    return "\n".join(lines) + "\n"


def _array(name: str, values: Sequence[float]) -> str:
    shown = ", ".join(_number(value) for value in values) or "0.0"
    return f"static const double {name}[{max(len(values), 1)}] = {{{shown}}};"


def _number(value: float) -> str:
    """A constant that reads back the same."""
    if math.isnan(value):
        return "NAN"
    if math.isinf(value):
        return "INFINITY" if value > 0.0 else "-INFINITY"
    return repr(float(value))


def _functions(text: str) -> Iterator[str]:
    """The functions of the straight-line code that the slave needs."""
    # the code is one assignment for each line, in order of evaluation, so that C needs no more than a
    # variable for each
    for function in text.split("end\n"):
        head, _, body = function.partition("\n")
        name = head.split()[1] if head else ""
        if name in _FUNCTIONS:
            yield _signature(_FUNCTIONS[name], ARGUMENTS[name])
            yield "{"
            yield "    " + " ".join(f"(void){array};" for array in ARGUMENTS[name])
            yield from (f"    {_line(line.split())}" for line in body.splitlines())
            yield "}"


def _signature(name: str, arguments: Sequence[str]) -> str:
    listed = ", ".join(f"{'' if array in _WRITTEN else 'const '}double *{array}" for array in arguments)
    return f"static void {name}({listed})"


def _line(words: Sequence[str]) -> str:
    """One operation: ``17 * 3 12`` is ``const double v17 = v3 * v12;``."""
    if words[0] == "store":
        return f"{words[1]}[{words[2]}] = v{words[3]};"
    return f"const double v{words[0]} = {_operation(words[1], words[2:])};"


def _operation(name: str, arguments: Sequence[str]) -> str:
    if name == "load":
        return f"{arguments[0]}[{arguments[1]}]"
    if name == "constant":
        return _number(float(arguments[0]))
    if name in _OPERATORS:
        return f"v{arguments[0]} {name} v{arguments[1]}"
    if name == "negative":
        return f"-v{arguments[0]}"
    if name == "power":
        exponent = Fraction(arguments[1]) if "/" in arguments[1] else Fraction(float(arguments[1]))
        return f"pow(v{arguments[0]}, {_number(float(exponent))})"
    return f"{name}(v{arguments[0]})"


def _input_delays(system: System) -> Iterator[str]:
    """A function that has a delay for every input; 0 where there is none."""
    arguments = ("y", "before", "after", "q", "delay")
    yield _signature("eq_input_delays", arguments).replace("const double *delay", "double *delay")
    yield "{"
    yield f"    double value[{max(len(system.delays), 1)}] = {{0.0}};"
    yield "    eq_delays(y, before, after, q, value);"
    indices: Mapping[str, int] = {name: index for index, name in enumerate(system.input_names)}
    for index, delay in enumerate(system.delays):
        yield f"    delay[{indices[delay.input]}] = value[{index}];"
    yield "    (void)delay;"
    yield "}"
