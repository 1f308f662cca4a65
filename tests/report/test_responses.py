"""Results as functions of the swept variables."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from report.conftest import RunMaker
from report.made_campaign import PRESSURES, TEMPERATURES, published_stroke
from rigctl.dataset import exclude, open_run
from rigctl.report.responses import responses
from rigctl.report.run_data import RunData, read_run
from rigctl.report.sections.campaign import sentence, table


def test_the_stroke_is_shown_over_temperature_for_each_pressure(published_data: RunData) -> None:
    stroke, travel = responses([published_data])
    assert (stroke.name, stroke.unit, stroke.x_name, stroke.x_unit) == ("stroke", "mm", "oil", "degC")
    assert stroke.xs == TEMPERATURES
    assert [one.label for one in stroke.series] == [f"supply {pressure:g} bar" for pressure in PRESSURES]
    point = stroke.series[2].at(60.0)
    assert point is not None
    assert point.mean == pytest.approx(published_stroke(60.0, 40.0), abs=0.1)
    assert travel.name == "travel"


def test_the_largest_change_is_described(published_data: RunData) -> None:
    stroke = responses([published_data])[0]
    said = sentence(stroke).replace("\N{NO-BREAK SPACE}", " ")
    assert said.startswith("Largest change with oil temperature: the stroke falls by 6.")
    assert said.endswith("at supply 40 bar, from 20 °C to 60 °C.")


def test_the_table_has_a_row_per_temperature_and_the_change_from_the_first(published_data: RunData) -> None:
    rows = table(responses([published_data])[0])
    assert [head for head, _ in rows] == ["20", "30", "40", "50", "60", "70", "80"]
    assert rows[0][1][0].change == ""
    assert rows[4][1][0].value == "73.3"
    assert rows[4][1][0].change == "−3.7"


def test_replicates_are_averaged_with_their_scatter(make_run: RunMaker) -> None:
    run = read_run(make_run(temperatures=(20.0, 30.0), pressures=(30.0,), repeats=3, idle_rows=2))
    point = responses([run])[0].series[0].points[0]
    assert len(point.values) == 3
    assert point.spread is not None
    assert "n = 3" in table(responses([run])[0])[0][1][0].spread


def test_excluded_and_incomplete_records_are_left_out(make_run: RunMaker) -> None:
    made = make_run(temperatures=(20.0, 30.0, 40.0), pressures=(30.0,), idle_rows=2)
    exclude(made.folder, [1], "the hose burst")
    data = read_run(open_run(made.folder))
    assert data.records[1].excluded == "the hose burst"
    assert responses([data])[0].xs == (20.0, 40.0)
    failed = replace(data, records=(replace(data.records[0], outcome="failed"), *data.records[1:]))
    assert responses([failed]) == []  # one operating point is no sweep


def test_several_runs_are_distinguished_in_the_labels(make_run: RunMaker) -> None:
    first = make_run(temperatures=(20.0, 40.0), pressures=(30.0,), idle_rows=2)
    second = make_run(temperatures=(20.0, 40.0), pressures=(30.0,), idle_rows=2, seed=2)
    labels = [one.label for one in responses([read_run(first), read_run(second)])[0].series]
    assert labels == [f"{first.id} · supply 30 bar", f"{second.id} · supply 30 bar"]


def test_another_unit_of_the_same_sweep_is_converted(make_run: RunMaker) -> None:
    data = read_run(make_run(temperatures=(20.0, 40.0), pressures=(30.0,), idle_rows=2))
    cold = replace(data.records[0], sweep={**data.records[0].sweep, "oil": (293.15, "K")})
    kelvin = replace(data, records=(data.records[1], cold))
    assert responses([kelvin])[0].xs == pytest.approx((20.0, 40.0))


def test_runs_without_a_sweep_have_no_response(make_run: RunMaker, tmp_path: Path) -> None:
    assert responses([read_run(make_run(temperatures=(20.0,), pressures=(30.0,), idle_rows=2))]) == []
