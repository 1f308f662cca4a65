"""The course of an error over time, in words: its sign, size and times, and the condition it depends on."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from made_fit import RECORDS, SIZE, made_fit, made_noise
from rigctl.analysis.agreement.error_course import dependence, error_course
from rigctl.answers.held_out import course_text
from rigctl.model.fit.fit import FitResult
from rigctl.units import significant

Floats = np.ndarray


def said(fit: FitResult, channel: str = "position") -> str:
    return course_text(fit, error_course(fit, channel))


def in_hold(place: int, times: Floats) -> Floats:
    return 0.4 * ((times >= SIZE) & (times < 2 * SIZE))


@pytest.mark.parametrize("correlation", [0.0, 0.9])
def test_no_stretch_is_reported_in_pure_noise(correlation: float) -> None:
    for seed in range(10):
        fit = made_fit(made_noise(correlation), seed)
        assert said(fit) == said(fit, "pressure") == ""


def test_a_model_too_high_in_one_phase_is_reported_for_that_phase_only() -> None:
    """0.4 m for the 60 s of the hold; the other channel is right."""
    fit = made_fit(made_noise(0.6), 1, in_hold)
    (stretch,) = error_course(fit, "position")
    assert (stretch.start, stretch.end) == pytest.approx((SIZE, 2 * SIZE - 1))
    assert stretch.peak == pytest.approx(0.4, abs=0.1)
    assert said(fit).startswith("in position the model is too high by up to 4")
    assert said(fit).endswith("mm from 60 to 119 s")
    assert said(fit, "pressure") == ""


def test_stretches_of_opposite_sign_are_reported_in_time_order() -> None:
    fit = made_fit(made_noise(), 1, lambda place, times: np.where(times < SIZE, -0.2, 0.5))
    text = said(fit)
    assert text.startswith("in position the model is too low by up to 2")
    assert "mm from 0 to 59 s, then too high by up to 5" in text
    assert text.endswith("mm from 60 to 179 s")


def test_an_error_over_the_whole_record_is_reported_as_lasting_all_the_time() -> None:
    fit = made_fit(made_noise(), 1, lambda place, times: np.full(times.shape, -0.3))
    assert said(fit).startswith("in position the model is too low by up to 3")
    assert said(fit).endswith("mm all the time")


def test_the_first_stretch_of_a_decaying_error_is_at_the_start_of_the_record() -> None:
    fit = made_fit(made_noise(sigma=0.02), 1, lambda place, times: 0.5 * np.exp(-times / 5.0))
    first = error_course(fit, "position")[0]
    assert first.start == 0.0
    assert first.end < SIZE
    assert first.peak > 0.4


def test_the_condition_that_the_error_depends_on_is_named_with_its_extremes() -> None:
    """0 at 20 °C, 1.1 m at 31 °C."""
    fit = made_fit(made_noise(), 1, lambda place, times: 0.1 * place * (times >= SIZE))
    stretch = error_course(fit, "position")[-1]
    assert stretch.by_record == pytest.approx(0.1 * np.arange(RECORDS), abs=0.05)
    low, high = (f"{significant(1e3 * stretch.by_record[place], 2, sign=True)} mm" for place in (0, -1))
    assert f"({low} at oil 20 degC, {high} at oil 31 degC)" in said(fit)


def test_an_error_equal_in_all_records_depends_on_no_condition() -> None:
    assert " at oil " not in said(made_fit(made_noise(), 1, in_hold))


def test_a_condition_at_whose_ends_the_errors_hardly_differ_does_not_hide_another() -> None:
    """The errors follow the oil most closely, but not at its lowest and highest values."""
    fit = made_fit(made_noise(), 1, in_hold)
    stretch = replace(error_course(fit, "position")[0], peak=12.0, by_record=np.linspace(10.0, 13.8, RECORDS))
    oil = [0.5, 0.0, *range(2, RECORDS - 2), 11.0, 10.5]
    supply = [0.0, 3.0, 1.0, 5.0, 2.0, 7.0, 4.0, 9.0, 6.0, 10.0, 8.0, 11.0]
    problem: Any = fit.problem
    problem.records = tuple(
        replace(record, condition={"oil": oil[k], "supply": supply[k]})
        for k, record in enumerate(problem.records)
    )
    problem.measurements = replace(problem.measurements, records=problem.records)
    found = dependence(fit, stretch)
    assert found is not None
    assert (found.variable, found.ends) == ("supply", ((0.0, 10.0), (11.0, 13.8)))
