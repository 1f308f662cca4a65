"""Look-up tables and fitted exponents in a family file, compared with SciPy's interpolation."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import PchipInterpolator

from rigctl.engine.compile import compile_system
from rigctl.engine.excitation import Excitation
from rigctl.engine.simulate import simulate
from rigctl.errors import RigctlError
from rigctl.model.build import build_system
from rigctl.physics.interpolation import Curve
from rigctl.physics.scope import Scope
from rigctl.physics.user import parse_family

FAMILY = """\
family: pump_table
states: {row: {start: 0 s, scale: 1 s, rate: 1}}
inputs: {flow: {value: 5 l/min}}
parameters:
  scale: {value: 1.5, bounds: [0.1, 10]}
  exponent: {value: 1.8, bounds: [1, 3]}
tables:
  curve: {over: l/min, unit: m, points: [[0, 21], [10, 20], [20, 17], [30, 11], [40, 1]]}
  warm: {over: l/min, unit: degC, kind: linear, points: [[0, 21], [10, 20], [20, 30]]}
outputs:
  head: {unit: m, formula: "scale*table(flow, curve)"}
  drop: {unit: m, formula: "1 m*spow(flow/(20 l/min), exponent, 1e-4)"}
  temperature: {unit: degC, formula: "table(flow, warm)"}
"""
POINTS = np.array([[0.0, 21.0], [10.0, 20.0], [20.0, 17.0], [30.0, 11.0], [40.0, 1.0]])


def test_tables_and_exponents_of_a_family_file_agree_with_scipy() -> None:
    system = build_system(parse_family(FAMILY), {})
    flow = np.linspace(-7.3, 47.1, 120)
    rows = np.arange(float(flow.size))
    record = Excitation(rows + 0.5, rows, flow[:, None] / 60e3, [0.0], system.nominal)
    found = simulate(compile_system(system), [record], columns=("scale", "exponent")).require()
    head, drop, temperature = found.outputs[0].T
    cubic = PchipInterpolator(*POINTS.T)
    inside = (flow >= 0.0) & (flow <= 40.0)
    assert head[inside] == pytest.approx(1.5 * cubic(flow[inside]), abs=1e-9)
    low, high = flow < 0.0, flow > 40.0
    assert head[low] == pytest.approx(1.5 * (21.0 + cubic(0.0, 1) * flow[low]), abs=1e-9)
    assert head[high] == pytest.approx(1.5 * (1.0 + cubic(40.0, 1) * (flow[high] - 40.0)), abs=1e-9)
    assert drop == pytest.approx(np.sign(flow) * np.abs(flow / 20.0) ** 1.8, abs=1e-6)
    far = np.abs(flow[:, None] - [0.0, 10.0, 20.0]).min(axis=1) > 1.0
    straight = np.interp(flow, [0.0, 10.0, 20.0], [21.0, 20.0, 30.0])
    between = far & (flow > 0.0) & (flow < 20.0)
    assert temperature[between] - 273.15 == pytest.approx(straight[between], abs=2e-2)
    slopes = found.sensitivities[0]
    assert slopes[:, 0, 0] == pytest.approx(head / 1.5)
    expected = np.sign(flow) * np.abs(flow / 20.0) ** 1.8 * np.log(np.abs(flow / 20.0))
    assert slopes[:, 1, 1] == pytest.approx(expected, abs=1e-5)


@settings(max_examples=50)
@given(
    steps=st.lists(st.floats(0.01, 100.0), min_size=1, max_size=30),
    seed=st.integers(0, 10**6),
    kind=st.sampled_from(["cubic", "linear"]),
)
def test_a_curve_agrees_with_scipy_interpolation(steps: list[float], seed: int, kind: str) -> None:
    x = np.cumsum([0.0, *steps])
    y = np.random.default_rng(seed).normal(size=x.size).cumsum()
    curve = Curve("c", "m", "V", tuple(x.tolist()), tuple(y.tolist()), kind)  # type: ignore[arg-type]
    scope = Scope(parse_family(FAMILY), {})
    between = np.unique(np.concatenate([x, np.linspace(x[0], x[-1], 200)]))
    got = np.array([curve(scope, float(at)) for at in between])
    reference = PchipInterpolator(x, y)(between) if kind == "cubic" else np.interp(between, x, y)
    room = 1e-6 if kind == "cubic" else 0.05
    assert np.abs(got - reference).max() <= room * (np.abs(np.diff(y)).sum() + 1e-12)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("table(flow, curve)", "table(flow, curv)", "unknown table, got 'curv'; expected warm or curve"),
        ("table(flow, curve)", "table(scale, curve)", "curve is looked up by a flow, not by a plain number"),
        ("table(flow, curve)", "curve", "a table is looked up, got 'curve'; expected table(x, curve)"),
        ("table(flow, curve)", "table(flow)", "a value and the name of a table"),
        ("scale*table(flow, curve)", "scale*table(flow, warm)", "cannot multiply a temperature by a number"),
        ("[10, 20], [20, 17]", "[10, 20], [10, 17]", "the points of a table must have rising x"),
        ("flow/(20 l/min), exp", "flow, exp", "cannot take spow of a flow"),
        ("unit: m, points", "unit: mx, points", "unknown unit, got 'mx'"),
    ],
)
def test_mistakes_in_a_table_are_refused_with_a_clear_message(old: str, new: str, said: str) -> None:
    assert old in FAMILY
    with pytest.raises(RigctlError) as refused:
        parse_family(FAMILY.replace(old, new))
    assert said.partition(";")[0] in str(refused.value)
