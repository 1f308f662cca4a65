"""Small linear systems: eliminated in order where that is exact, with row exchanges where it is not."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from rigctl.engine.kernels import linear

Floats = NDArray[np.float64]

# the kernels as plain Python: what they compute does not depend on the compiler
factorise, in_order = linear.factorise.py_func, linear.factorise_in_order.py_func
solve, solve_columns = linear.solve.py_func, linear.solve_columns.py_func


def eliminate(matrix: Floats, unit: Floats) -> tuple[bool, Floats, NDArray[np.int64]]:
    """Whether it went in order, the factors and the exchanges."""
    n = len(matrix)
    factors, exchanges = matrix.flatten(), np.zeros(n, dtype=np.int64)
    with np.errstate(all="ignore"):  # as in compiled code
        went = in_order(n, factors, exchanges, unit, np.zeros(n))
    if went:
        return True, factors, exchanges
    factors = matrix.flatten()
    factorise(n, factors, exchanges)
    return False, factors, exchanges


@settings(max_examples=60)
@given(st.integers(1, 9), st.integers(0, 10_000))
def test_solutions_are_exact_whichever_way(n: int, seed: int) -> None:
    """In units twelve powers of ten apart, as pressures and positions are."""
    random = np.random.default_rng(seed)
    unit = 10.0 ** random.uniform(-6.0, 6.0, n)
    matrix = np.eye(n) + random.normal(size=(n, n)) * random.integers(0, 2, (n, n))
    if np.linalg.cond(matrix) > 1e4:
        return
    wanted = random.normal(size=(n, 3))
    given_matrix = unit[:, None] * matrix / unit
    right = unit[:, None] * (matrix @ wanted)
    _, factors, exchanges = eliminate(given_matrix, unit)
    columns, one = right.flatten(), right[:, 0].copy()
    solve_columns(n, 3, factors, exchanges, columns)
    solve(n, factors, exchanges, one)
    assert columns.reshape(n, 3) / unit[:, None] == pytest.approx(wanted, abs=1e-8)
    assert one / unit == pytest.approx(wanted[:, 0], abs=1e-8)


def test_rows_are_exchanged_where_a_pivot_is_small_in_its_unit() -> None:
    matrix = np.array([[1e-9, 1.0], [1.0, 1.0]])
    went, factors, exchanges = eliminate(matrix, np.ones(2))
    assert not went
    right = np.array([1.0, 2.0])
    solve(2, factors, exchanges, right)
    assert right == pytest.approx(np.linalg.solve(matrix, [1.0, 2.0]), rel=1e-14)
    # the same numbers are no reason to exchange where the first unknown is a pressure, the second a position
    assert eliminate(matrix, np.array([1e6, 1e-6]))[0]


@pytest.mark.parametrize("bad", [0.0, np.nan])
def test_a_pivot_that_is_none_is_refused(bad: float) -> None:
    assert not eliminate(np.array([[bad, 1.0], [1.0, 1.0]]), np.ones(2))[0]
