"""Small linear systems: elimination in order if that is accurate, otherwise with row exchanges."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from rigctl.engine.compile import compile_system
from rigctl.engine.elimination import ARGUMENTS, elimination
from rigctl.engine.excitation import Excitation
from rigctl.engine.kernels import linear
from rigctl.engine.simulate import simulate
from rigctl.engine.system import SystemBuilder

Floats = NDArray[np.float64]

# the kernels as plain Python: their results do not depend on the compiler
factorise, solve = linear.factorise.py_func, linear.solve.py_func
exchange_rows, solve_columns = linear.exchange_rows.py_func, linear.solve_columns.py_func

_WORKS = {
    "negative": lambda a: -a,
    "fabs": abs,
    "+": lambda a, b: a + b,
    "-": lambda a, b: a - b,
    "*": lambda a, b: a * b,
    "/": lambda a, b: a / b,
    "larger": lambda a, b: max(b, a),  # b where a is not a number
    "beyond": lambda a, b: float(not a <= b),
}


def carry_out(text: str, function: str, *arrays: Floats) -> None:
    """Execute the straight-line code of a function."""
    known = dict(zip(ARGUMENTS[function], arrays, strict=True))
    start = text.index(f"function {function} ")
    numbers: list[np.float64] = []
    with np.errstate(all="ignore"):  # as in compiled code
        for line in text[start : text.index("\nend\n", start)].split("\n")[1:]:
            first, operation, *rest = line.split()
            if first == "store":
                known[operation][int(rest[0])] = numbers[int(rest[1])]
            elif operation == "load":
                numbers.append(np.float64(known[rest[0]][int(rest[1])]))
            elif operation == "constant":
                numbers.append(np.float64(rest[0]))
            else:
                numbers.append(np.float64(_WORKS[operation](*(numbers[int(at)] for at in rest))))


def in_order(matrix: Floats, unit: Floats, reach: float = 1.0) -> tuple[bool, str, Floats]:
    """Whether `matrix` = ``I - reach·J`` is eliminated without row exchange; its code, and the factors."""
    n = len(matrix)
    jacobian = (np.eye(n) - matrix) / reach
    text = elimination(n, zip(*(places.tolist() for places in np.nonzero(jacobian)), strict=True))
    factors, refused = np.zeros(n * n), np.zeros(1)
    carry_out(text, "factorise", jacobian.flatten(), unit, np.array([reach]), factors, refused)
    return bool(refused[0] == 0.0), text, factors


@settings(max_examples=60)
@given(st.integers(1, 9), st.integers(0, 10_000))
def test_solutions_are_accurate_with_and_without_row_exchanges(n: int, seed: int) -> None:
    """In units twelve powers of ten apart, as for pressures and positions."""
    random = np.random.default_rng(seed)
    unit = 10.0 ** random.uniform(-6.0, 6.0, n)
    matrix = np.eye(n) + random.normal(size=(n, n)) * random.integers(0, 2, (n, n))
    if np.linalg.cond(matrix) > 1e4:
        return
    wanted = random.normal(size=(n, 3))
    given_matrix = unit[:, None] * matrix / unit
    right = unit[:, None] * (matrix @ wanted)
    columns, one = right.flatten(), right[:, 0].copy()
    went, text, factors = in_order(given_matrix, unit)
    if went:
        carry_out(text, "solve", factors, one)
    else:
        factors, exchanges = given_matrix.flatten(), np.zeros(n, dtype=np.int64)
        factorise(n, factors, exchanges)
        exchange_rows(n, 3, exchanges, columns)
        solve(n, factors, exchanges, one)
    solve_columns(n, 3, factors, columns)
    assert columns.reshape(n, 3) / unit[:, None] == pytest.approx(wanted, abs=1e-8)
    assert one / unit == pytest.approx(wanted[:, 0], abs=1e-8)


def test_rows_are_exchanged_if_a_pivot_is_small_relative_to_its_unit() -> None:
    matrix = np.array([[1e-9, 1.0], [1.0, 1.0]])
    assert not in_order(matrix, np.ones(2))[0]
    factors, exchanges = matrix.flatten(), np.zeros(2, dtype=np.int64)
    factorise(2, factors, exchanges)
    right = np.array([1.0, 2.0])
    solve(2, factors, exchanges, right)
    assert right == pytest.approx(np.linalg.solve(matrix, [1.0, 2.0]), rel=1e-14)
    # the same numbers need no exchange if the first unknown is a pressure and the second a position
    assert in_order(matrix, np.array([1e6, 1e-6]))[0]


@pytest.mark.parametrize("bad", [0.0, np.nan])
def test_a_zero_pivot_is_refused(bad: float) -> None:
    assert not in_order(np.array([[bad, 1.0], [1.0, 1.0]]), np.ones(2))[0]


def test_operations_on_structural_zeros_are_omitted() -> None:
    """The number of operations for a chain of lags grows with its length, not with the cube of it."""
    lengths = {}
    for n in (10, 40):
        chain = [(i, j) for i in range(n) for j in (i - 1, i) if j >= 0]
        lengths[n] = elimination(n, chain).count("\n")
    assert lengths[40] < 4.5 * lengths[10]


def test_records_are_accurate_if_only_some_steps_exchange_rows() -> None:
    """A stiff spring, integrated with steps much longer than its period, beside a slow lag."""
    stiffness = 1e6
    builder = SystemBuilder()
    x, v = builder.state("x", "m", scale=1e-3), builder.state("v", "m/s", scale=10.0)
    slow, u = builder.state("slow", "m", scale=1e-3), builder.input("u", "m")
    k = builder.parameter("k", "1/s^2", stiffness)
    c = builder.parameter("c", "1/s", 100.0)
    rate = builder.parameter("rate", "1/s", 2.0)
    builder.equation("x", v)
    builder.equation("v", k * (slow - x) - c * v)
    builder.equation("slow", rate * (u - slow))
    builder.output("x", "m", x)
    compiled = compile_system(builder.build())
    times = np.linspace(0.0, 2.0, 41)
    start = np.zeros(3)
    record = Excitation(times, np.array([0.0]), np.array([[1.0]]), start, np.array([stiffness, 100.0, 2.0]))
    found = simulate(compiled, [record], columns=["rate"]).require()
    # the spring follows the lag to well within the tolerance
    assert found.output("x")[0][5:] == pytest.approx(1.0 - np.exp(-2.0 * times[5:]), abs=5e-3)
    slope = found.sensitivity("x", "rate")[0][5:]
    assert slope == pytest.approx(times[5:] * np.exp(-2.0 * times[5:]), abs=5e-3)
    # its matrix needs row exchanges at the later, longer steps, not at the first ones
    spring = np.array([[0.0, 1.0], [-stiffness, -100.0]])
    units = np.array([1e-3, 10.0])  # as the states' scales
    for reach, expected in ((1e-5, True), (0.02, False)):
        assert in_order(np.eye(2) - reach * spring, units, reach)[0] is expected
