"""Spline columns of a term compared with SciPy's splines, its integrator and finite differences."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.interpolate import BSpline

from rigctl.engine.compile import compile_system
from rigctl.engine.excitation import Excitation
from rigctl.engine.simulate import simulate
from rigctl.engine.splines import SplineArgument, SplineColumn, SplineColumns, knots_over
from rigctl.engine.system import System, SystemBuilder
from rigctl.engine.tolerance import TIGHT
from rigctl.errors import RigctlError

FUNCTIONS = 6
TIMES = np.linspace(0.0, 2.0, 41)


def _oscillator() -> System:
    """``x' = v, v' = u − k·x − c·|v|·v``; the reading is x with the relative error `error`."""
    builder = SystemBuilder()
    x, v = builder.state("x", "m", 1e-2), builder.state("v", "m/s", 1e-2)
    u = builder.input("u", "m/s^2")
    k, c = builder.parameter("k", "1/s^2", 9.0), builder.parameter("c", "1/m", 0.8)
    error = builder.parameter("error", "1", 0.1)
    builder.equation("x", v)
    builder.equation("v", u - k * x - c * v * v * v / (v * v + builder.constant(1e-4, "m^2/s^2")) ** 0.5)
    builder.output("reading", "m", x * (1.0 + error))
    return builder.build()


def _record() -> Excitation:
    return Excitation(
        TIMES,
        np.array([0.0, 0.9]),
        np.array([[3.0], [-2.0]]),
        np.array([0.1, 0.0]),
        np.array([9.0, 0.8, 0.1]),
    )


def _by_scipy(drag: BSpline | None, gain: BSpline | None, size: float) -> NDArray[np.float64]:
    """The reading, the drag weighted by ``1 + size·drag(v)`` or the gain's error by ``1 + size·gain(x)``."""

    def rate(t: float, y: NDArray[np.float64]) -> list[float]:
        u = 3.0 if t < 0.9 else -2.0
        weight = 1.0 if drag is None else 1.0 + size * float(drag(np.clip(y[1], -1.0, 1.0)))
        return [y[1], u - 9.0 * y[0] - 0.8 * weight * y[1] ** 3 / (y[1] ** 2 + 1e-4) ** 0.5]

    found = [np.array([[0.1], [0.0]])]
    for begin, end in ((0.0, 0.9), (0.9, 2.0)):
        inside = TIMES[(begin < TIMES) & (end >= TIMES)]
        ends = np.unique([*inside, end])
        one = solve_ivp(rate, (begin, end), found[-1][:, -1], t_eval=ends, rtol=1e-11, atol=1e-13)
        found.append(one.y)
    y = np.concatenate(found, axis=1)[:, : TIMES.size]
    weight = 1.0 if gain is None else 1.0 + size * gain(np.clip(y[0], -0.5, 0.8))
    return np.asarray(y[0] * (1.0 + 0.1 * weight))


def _difference(drag: BSpline | None, gain: BSpline | None) -> NDArray[np.float64]:
    step = 1e-4
    return (_by_scipy(drag, gain, step) - _by_scipy(drag, gain, -step)) / (2.0 * step)


def test_columns_are_derivatives_with_respect_to_spline_coefficients() -> None:
    over_v, over_x = knots_over(-1.0, 1.0, FUNCTIONS, [-0.2, 0.3]), knots_over(-0.5, 0.8, FUNCTIONS)
    splines = SplineColumns(
        (SplineArgument({"v": 1.0}, over_v), SplineArgument({"x": 1.0}, over_x)),
        (
            *(SplineColumn({"c": 0.8}, (0, k)) for k in range(FUNCTIONS)),
            *(SplineColumn({"error": 0.1}, (1, k)) for k in range(FUNCTIONS)),
        ),
    )
    found = simulate(compile_system(_oscillator()), [_record()], splines=splines, tolerance=TIGHT).require()
    columns = found.sensitivities[0][:, 0]
    for k in range(FUNCTIONS):
        drag = BSpline(over_v, np.eye(FUNCTIONS)[k], 3)
        expected = _difference(drag, None)
        np.testing.assert_allclose(columns[:, k], expected, atol=2e-4 * np.abs(columns).max())
        gain = BSpline(over_x, np.eye(FUNCTIONS)[k], 3)
        expected = _difference(None, gain)
        np.testing.assert_allclose(columns[:, FUNCTIONS + k], expected, atol=1e-6)


def test_spline_columns_sum_to_the_column_of_their_term() -> None:
    """Splines sum to 1 over their range; the column of two parameters is the sum of their columns."""
    knots = knots_over(-3.0, 3.0, FUNCTIONS)
    splines = SplineColumns(
        (SplineArgument({"v": 1.0, "u": 0.1}, knots),),
        tuple(SplineColumn({"c": 0.8, "k": 9.0}, (0, k)) for k in range(FUNCTIONS)),
    )
    found = simulate(
        compile_system(_oscillator()), [_record()], columns=["c", "k"], splines=splines
    ).require()
    c, k, *weighed = np.moveaxis(found.sensitivities[0][:, 0], 1, 0)
    np.testing.assert_allclose(np.sum(weighed, axis=0), 0.8 * c + 9.0 * k, atol=1e-12)
    assert found.columns == ("c", "k", *(f"spline {n}" for n in range(FUNCTIONS)))


def test_columns_of_products_of_splines_sum_to_the_column_of_their_term() -> None:
    knots = knots_over(-3.0, 3.0, 5)
    splines = SplineColumns(
        (SplineArgument({"v": 1.0}, knots), SplineArgument({"x": 1.0}, knots_over(-1.0, 1.0, 5))),
        tuple(SplineColumn({"c": 0.8}, (0, i), (1, j)) for i in range(5) for j in range(5)),
    )
    found = simulate(compile_system(_oscillator()), [_record()], columns=["c"], splines=splines).require()
    columns = found.sensitivities[0][:, 0]
    np.testing.assert_allclose(columns[:, 1:].sum(axis=1), 0.8 * columns[:, 0], atol=1e-12)


def test_spline_columns_do_not_change_the_outputs() -> None:
    splines = SplineColumns(
        (SplineArgument({"v": 1.0}, knots_over(-1.0, 1.0, FUNCTIONS)),),
        tuple(SplineColumn({"c": 0.8}, (0, k)) for k in range(FUNCTIONS)),
    )
    compiled = compile_system(_oscillator())
    plain, with_columns = (
        simulate(compiled, [_record()], **more).outputs[0] for more in ({}, {"splines": splines})
    )
    assert np.array_equal(plain, with_columns)


@pytest.mark.parametrize(
    ("arguments", "column", "said"),
    [
        ({"speed": 1.0}, SplineColumn({"c": 1.0}, (0, 0)), "unknown state or input of a spline"),
        ({"v": 1.0}, SplineColumn({"drag": 1.0}, (0, 0)), "unknown parameter that carries a term"),
        ({"v": 1.0}, SplineColumn({"c": 1.0}, (0, 9)), "a function that there is not"),
        ({"v": 1.0}, SplineColumn({"c": 1.0}, (0, 0), (1, 0)), "a function that there is not"),
    ],
)
def test_unknown_names_and_functions_are_refused(
    arguments: dict[str, float], column: SplineColumn, said: str
) -> None:
    with pytest.raises(RigctlError, match=said):
        simulate(
            compile_system(_oscillator()),
            [_record()],
            splines=SplineColumns((SplineArgument(arguments, knots_over(-1.0, 1.0, FUNCTIONS)),), (column,)),
        )


def test_decreasing_or_too_few_knots_are_refused() -> None:
    knots = knots_over(0.0, 1.0, FUNCTIONS)
    with pytest.raises(RigctlError, match="do not rise"):
        SplineColumns((SplineArgument({"v": 1.0}, knots[::-1].copy()),))
    with pytest.raises(RigctlError, match="needs 8 knots"):
        SplineColumns((SplineArgument({"v": 1.0}, knots[:7]),))
