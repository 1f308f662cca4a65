"""From equations to compiled derivatives: this engine's graph compared with SymPy and SymEngine.

    python -m benchmarks.engine.front_ends [--runs 3]

The model is the benchmark's: 7 states, 28 parameters, all effects in it. Every front end starts from the same
equations and ends with straight-line source of f, ∂f/∂y and ∂f/∂q with shared subexpressions. Then the two
ways to machine code are timed: statements through numba's Python front end, or straight to LLVM.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks.engine import cylinder
from benchmarks.record import keep, table
from rigctl.engine.source import source_of
from rigctl.engine.symbols import to_text
from rigctl.engine.system import System


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--runs", type=int, default=3)
    runs = arguments.parse_args().runs
    system = cylinder.build()
    results: dict[str, Any] = {"build": {"rigctl": builds(lambda: source_of(cylinder.build()), runs)}}
    for name in ("sympy", "symengine"):
        try:
            work = front_end(name, system)
        except ImportError:
            print(f"{name} is not installed: left out")
            continue
        results["build"][name] = builds(work, runs)
    results["compile"] = {name: in_fresh_process(name, runs) for name in ("straight_line", "statements")}
    results["whole process, model in the cache"] = cached_process(runs)
    ours = results["build"]["rigctl"]
    rows = [("front end", "seconds", "ratio")]
    rows += [(name, f"{took:.4f}", f"{took / ours:.1f}x") for name, took in results["build"].items()]
    table("equations to straight-line source, with exact derivatives", rows)
    rows = [("way to machine code", "seconds")]
    rows += [(name, f"{took:.2f}") for name, took in results["compile"].items()]
    table("straight-line source to machine code, the compiler imported and warm", rows)
    took = results["whole process, model in the cache"]
    print(f"\na whole process with kernels and model in the cache: {took:.2f} s")
    print(f"kept in {keep(Path(__file__).parent, results, 'sympy', 'symengine', 'numba', name='front_ends')}")


def builds(work: Callable[[], object], runs: int) -> float:
    """Median seconds; every run starts afresh."""
    times = []
    for _ in range(runs):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return statistics.median(times)


def front_end(name: str, system: System) -> Callable[[], object]:
    """Differentiate and share subexpressions with SymPy's interface, which SymEngine also has."""
    library = __import__(name)
    names = [*system.state_names, *system.input_names, *system.parameter_names]
    texts = [to_text(expr) for expr in system.rhs]

    def work() -> object:
        if name == "sympy":
            library.core.cache.clear_cache()
        symbols = {one: library.Symbol(one) for one in names}
        functions = {one: getattr(library, one) for one in ("exp", "log", "sqrt", "tanh")}
        rhs = [eval(text, {**functions, **symbols}) for text in texts]
        varied = [symbols[one] for one in (*system.state_names, *system.parameter_names)]
        entries = [*rhs, *(expr.diff(variable) for expr in rhs for variable in varied)]
        shared, reduced = library.cse(entries)
        return "\n".join([*(f"{left} = {right}" for left, right in shared), *map(str, reduced)])

    return work


def in_fresh_process(way: str, runs: int) -> float:
    """Median seconds to compile a model's functions in a process without a cache."""
    program = f"from benchmarks.engine.front_ends import compile_{way}; print(compile_{way}())"
    found = [
        subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True)
        for _ in range(runs)
    ]
    return statistics.median(float(one.stdout) for one in found)


def compile_straight_line() -> float:
    """Seconds for a model's functions straight to LLVM."""
    from rigctl.engine.machine_code import compiled, loaded
    from rigctl.engine.source import ARGUMENTS
    from rigctl.engine.straight_line import module_of

    smallest = "define void @nothing() {\n  ret void\n}\n"
    loaded(compiled(smallest, ["nothing"]))  # initialises LLVM, outside the timing
    text = source_of(cylinder.build()).text
    start = time.perf_counter()
    assert all(loaded(compiled(module_of(text), ARGUMENTS)).values())
    return time.perf_counter() - start


def compile_statements() -> float:
    """Seconds for the same with Python statements, the usual way to use numba."""
    import math

    import numba

    from rigctl.engine.source import ARGUMENTS

    warm_up()
    text = source_of(cylinder.build()).text
    pointer = numba.types.CPointer(numba.types.float64)
    start = time.perf_counter()
    for name, arguments in ARGUMENTS.items():
        names: dict[str, Any] = {"math": math}
        exec(statements(text, name, ", ".join(arguments)), names)
        signature = numba.types.void(*[pointer] * len(arguments))
        assert numba.cfunc(signature, error_model="numpy")(names[name]).address
    return time.perf_counter() - start


def statements(text: str, name: str, arguments: str) -> str:
    """The straight-line code of one function as Python."""
    start = text.index(f"function {name} ")
    lines = [f"def {name}({arguments}):"]
    for number, operation, *args in (
        line.split() for line in text[start : text.index("\nend", start)].split("\n")[1:]
    ):
        if number == "store":
            lines.append(f"    {operation}[{args[0]}] = t{args[1]}")
        elif operation == "load":
            lines.append(f"    t{number} = {args[0]}[{args[1]}]")
        elif operation == "constant":
            lines.append(f"    t{number} = {args[0]}")
        elif operation in "+-*/":
            lines.append(f"    t{number} = t{args[0]} {operation} t{args[1]}")
        elif operation == "larger":
            lines.append(f"    t{number} = t{args[0]} if t{args[0]} > t{args[1]} else t{args[1]}")
        elif operation == "beyond":
            lines.append(f"    t{number} = 0.0 if t{args[0]} <= t{args[1]} else 1.0")
        elif operation == "negative":
            lines.append(f"    t{number} = -t{args[0]}")
        elif operation == "power":
            lines.append(f"    t{number} = t{args[0]} ** ({args[1]})")
        else:
            lines.append(f"    t{number} = math.{operation}(t{args[0]})")
    return "\n".join([*lines, "    return"])


def warm_up() -> None:
    """Initialise numba, which would otherwise count for the first function."""
    import numba

    double = numba.types.float64
    numba.cfunc(double(double))(lambda x: 2.0 * x)


def cached_process(runs: int) -> float:
    """Median seconds of a process that compiles the model a second time, Python's own start included."""
    program = (
        "from benchmarks.engine import cylinder; from rigctl.engine.compile import compile_system;"
        "compile_system(cylinder.build())"
    )
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, "RIGCTL_CACHE_DIR": folder}
        subprocess.run([sys.executable, "-c", program], check=True, env=environment)
        return builds(
            lambda: subprocess.run([sys.executable, "-c", program], check=True, env=environment), runs
        )


if __name__ == "__main__":
    main()
