"""The search for a minimum on an interval, step by step equal to SciPy's."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize_scalar

from rigctl.noise.minimum import least_between

FUNCTIONS: dict[str, Callable[[float], float]] = {
    "parabola": lambda x: (x - 0.3) ** 2,
    "corner": lambda x: abs(x - 0.3),
    "steps": lambda x: round((x - 0.3) ** 2, 1),
    "waves": lambda x: math.sin(5.0 * x) + 0.3 * x,
    "falling": lambda x: -x,
    "flat": lambda _: 1.0,
}


@pytest.mark.parametrize("name", FUNCTIONS)
@given(st.floats(-2.0, 1.0), st.floats(1e-3, 5.0), st.sampled_from([1e-8, 1e-3, 0.03]))
def test_every_step_equals_that_of_scipy(name: str, low: float, width: float, within: float) -> None:
    seen: tuple[list[float], list[float]] = [], []

    def counted(x: float, where: list[float]) -> float:
        where.append(float(x))
        return FUNCTIONS[name](x)

    found = least_between(lambda x: counted(x, seen[0]), low, low + width, within)
    known = minimize_scalar(
        lambda x: counted(x, seen[1]),
        bounds=(low, low + width),
        method="bounded",
        options={"xatol": within},
    )
    assert seen[0] == seen[1]
    assert (found.at, found.value) == (float(known.x), float(known.fun))
