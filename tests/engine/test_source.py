"""Machine code compared with direct evaluation of the same expressions, and the digest of a model."""

from __future__ import annotations

import ctypes

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from engine_systems import lag_builder
from rigctl.engine import symbols
from rigctl.engine.compile import CompiledSystem, compile_system
from rigctl.engine.source import ARGUMENTS, source_of
from rigctl.engine.symbols import derivative, evaluate
from rigctl.engine.system import System, SystemBuilder


def every_operation() -> System:
    """One output for each kind of expression."""
    builder = SystemBuilder()
    x, y = builder.state("x", "1", scale=1.0), builder.state("y", "1", scale=1.0)
    u = builder.input("u", "1")
    p, q = builder.parameter("p", "1", 1.0), builder.parameter("q", "1", 1.0)
    builder.equation("x", builder.constant(1.0, "1/s") * (p * y - x * u))
    builder.equation("y", builder.constant(1.0, "1/s") * (q * x + 0.5))
    terms = [
        x + y * p,
        x - q / y,
        -(x * y) - u,
        symbols.exp(x * p),
        symbols.log(y + q),
        symbols.sqrt(y * p),
        symbols.tanh(x - q),
        x**2 + y**3 * p**7,
        y**-1 + p**-2 * x,
        y**1.5 * q,
        p**-0.5 + y**2.5,
        y**0.3 * q**1.7,
        symbols.power(y, x * p),
        symbols.positive_part(x - p, 0.1) * symbols.smooth_step(y, q),
    ]
    for number, term in enumerate(terms):
        builder.output(f"term_{number}", "1", term)
    return builder.build()


@pytest.fixture(scope="module")
def operations() -> CompiledSystem:
    return compile_system(every_operation())


def call(
    compiled: CompiledSystem, function: str, sizes: list[int], inputs: list[list[float]]
) -> list[np.ndarray]:
    """Call a function of the model as C does."""
    results = [np.zeros(size) for size in sizes]
    arrays = [np.array(values) for values in inputs] + results
    pointer = ctypes.POINTER(ctypes.c_double)
    address = int(compiled.addresses[list(ARGUMENTS).index(function)])
    native = ctypes.CFUNCTYPE(None, *[pointer] * len(arrays))(address)
    native(*(array.ctypes.data_as(pointer) for array in arrays))
    return results


# the compiled module is shared by all examples, as it is by all calls
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.floats(-2.0, 2.0), st.floats(0.2, 2.0), st.floats(-1.0, 1.0), st.floats(0.2, 2.0), st.floats(0.2, 2.0)
)
def test_machine_code_agrees_with_evaluation(
    operations: CompiledSystem, x: float, y: float, u: float, p: float, q: float
) -> None:
    system, source = operations.system, operations.source
    point = {"x": x, "y": y, "u": u, "p": p, "q": q}
    inputs = [[x, y], [u], [p, q]]
    count = len(system.outputs)
    entries = len(source.outputs_pattern)
    value, jacobian, packed = call(operations, "outputs_tangent", [count, count * 2, entries], inputs)
    assert np.array_equal(value, call(operations, "outputs", [count], inputs)[0])
    variables = system.graph.variables
    for row, output in enumerate(system.outputs):
        assert value[row] == pytest.approx(evaluate(output.expr, point), rel=1e-12, abs=1e-12)
        for column, state in enumerate(system.state_names):
            slope = evaluate(derivative(output.expr, variables[state]), point)
            assert jacobian[row * 2 + column] == pytest.approx(slope, rel=1e-12, abs=1e-12)
    for place, (row, column) in enumerate(source.outputs_pattern):
        parameter = variables[system.parameter_names[column]]
        slope = evaluate(derivative(system.outputs[row].expr, parameter), point)
        assert packed[place] == pytest.approx(slope, rel=1e-12, abs=1e-12)
    assert call(operations, "rhs", [2], inputs)[0] == pytest.approx([p * y - x * u, q * x + 0.5])


def test_sparsity_patterns_contain_only_actual_dependences(operations: CompiledSystem) -> None:
    assert operations.source.rhs_pattern == ((0, 0), (1, 1))
    assert (2, 0) not in operations.source.outputs_pattern
    assert operations.source.delays_pattern == ()


def test_the_digest_is_equal_for_equal_equations_and_changes_with_them() -> None:
    first, again = source_of(every_operation()), source_of(every_operation())
    assert first.digest == again.digest
    builder, names = lag_builder()
    plain = source_of(builder.build()).digest
    builder, names = lag_builder()
    builder.output("twice", "m", 2.0 * names["x"])
    assert source_of(builder.build()).digest != plain
    builder, names = lag_builder()
    builder.equation("x", 1.0000001 * (names["gain"] * names["u"] - names["x"]) / names["lag"])
    assert source_of(builder.build()).digest != plain


def test_declared_names_that_no_equation_uses_are_allowed() -> None:
    builder, _ = lag_builder()
    builder.parameter("idle", "K", 1.0)
    builder.input("spare", "W")
    compiled = compile_system(builder.build())
    assert compiled.source.rhs_pattern == ((0, 0), (0, 1))
