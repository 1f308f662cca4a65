"""Statistics and the expressions over them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigctl.errors import RigctlError
from rigctl.expressions import type_of_unit
from rigctl.plan.statistics import STATISTICS, Statistic, find_statistics
from rigctl.steps.measure import ReadMeasure, read_measure
from rigctl.units import parse_quantity

SIGNALS = {
    "position": type_of_unit("mm"),
    "supply_pressure": type_of_unit("bar"),
    "oil": type_of_unit("degC"),
    "valve": type_of_unit("1"),
}


def read(text: str, unit: str) -> ReadMeasure:
    answers = {"run_time": type_of_unit("s"), "reference": type_of_unit("degC")}
    return read_measure(text, unit, SIGNALS, answers, {"k": parse_quantity("2 cSt/s")})


def test_statistics_are_found_and_named_once() -> None:
    text, found = find_statistics("max(position) - min( position ) + 2 * max(position)")
    assert text == "max_of_position - min_of_position + 2 * max_of_position"
    assert found == (Statistic("max", "position"), Statistic("min", "position"))


def test_max_of_two_values_is_a_function_and_not_a_statistic() -> None:
    text, found = find_statistics("max(mean(position), last(position))")
    assert text == "max(mean_of_position, last_of_position)"
    assert [statistic.kind for statistic in found] == ["mean", "last"]


def test_the_stroke_is_measured_as_maximum_minus_minimum_position() -> None:
    measure = read("max(position) - min(position)", "mm")
    values = [0.001, 0.0, 0.08, 0.079]
    known = {statistic.key: statistic.compute(values) for statistic in measure.statistics}
    assert measure.expression.evaluate(known) == pytest.approx(0.08)


def test_a_temperature_subtracted_from_a_reading_is_a_point_on_the_scale() -> None:
    measure = read("mean(oil) - 45 degC", "K")
    assert float(measure.expression.evaluate({"mean_of_oil": 319.15})) == pytest.approx(1.0)


def test_measures_can_use_the_duration_answers_and_variables() -> None:
    measure = read("(last(position) - first(position)) / duration", "m/s")
    known = {"last_of_position": 0.1, "first_of_position": 0.0, "duration": 2.0}
    assert measure.expression.evaluate(known) == pytest.approx(0.05)
    assert read("$k * run_time", "cSt").expression.evaluate({"run_time": 17.0}) == pytest.approx(34e-6)


@pytest.mark.parametrize(
    ("text", "unit", "difference"),
    [
        ("mean(oil)", "degC", False),
        ("std(oil)", "K", True),
        ("max(oil) - min(oil)", "K", True),
        ("mean(oil) - reference", "K", True),
        ("mean(position)", "mm", False),
    ],
)
def test_a_difference_of_temperatures_has_that_type(text: str, unit: str, difference: bool) -> None:
    assert read(text, unit).difference is difference


@pytest.mark.parametrize(
    ("text", "unit", "piece"),
    [
        ("max(positoin)", "mm", "unknown channel, got 'positoin'; did you mean 'position'?"),
        ("max(position)", "bar", "the dimension of its unit"),
        ("max(position) - mean(supply_pressure)", "mm", "a length"),
        ("position", "mm", "a measure needs one value of a channel"),
        ("mean(oil) + first(oil)", "K", "temperature"),
        ("max(position) > 3 mm", "mm", "the dimension of its unit"),
        ("__import__('os')", "mm", "'"),
        ("run_tine", "s", "did you mean 'run_time'?"),
        ("$q * run_time", "s", "unknown variable"),
    ],
)
def test_mistakes_in_a_measure_are_reported(text: str, unit: str, piece: str) -> None:
    with pytest.raises(RigctlError) as caught:
        read(text, unit)
    assert piece in str(caught.value)


@given(st.lists(st.floats(-1e6, 1e6), min_size=2, max_size=50))
def test_statistics_agree_with_numpy(values: list[float]) -> None:
    expected = {
        "first": values[0],
        "last": values[-1],
        "min": np.min(values),
        "max": np.max(values),
        "mean": np.mean(values),
        "std": np.std(values, ddof=1),
    }
    assert expected.keys() == STATISTICS.keys()
    for kind, value in expected.items():
        found = Statistic(kind, "position").compute(values)
        assert found == pytest.approx(value, rel=1e-9, abs=1e-9 * max(map(abs, values), default=0.0) + 1e-12)


def test_missing_samples_are_left_out() -> None:
    assert Statistic("mean", "position").compute([math.nan, 1.0, 3.0]) == 2.0
    assert Statistic("first", "position").compute([math.nan, 1.0]) == 1.0
    assert math.isnan(Statistic("max", "position").compute([math.nan]))
    assert math.isnan(Statistic("mean", "position").compute([]))
    assert math.isnan(Statistic("std", "position").compute([1.0]))
