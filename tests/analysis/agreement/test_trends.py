"""The description of a quantity's change over the operating point."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from rigctl.analysis.agreement.trends import trends
from rigctl.answers.trends import trend_text
from rigctl.model.fit.fit import FitResult
from rigctl.model.measured.record import MeasuredRecord, Measurements

POWERS = (20.0, 40.0, 60.0)


def fitted(
    channel: str,
    unit: str,
    measured: tuple[float, ...],
    predicted: tuple[float, ...],
    powers: tuple[float, ...] = POWERS,
) -> FitResult:
    """A fit of one record for each power, each with one level measured and one predicted, SI."""
    records = tuple(
        MeasuredRecord(
            run="r",
            index=index,
            label=f"r/{index}",
            times=np.arange(10.0),
            switch_times=np.zeros(1),
            switch_half=np.zeros(1),
            inputs=np.zeros((1, 1)),
            values=np.full((10, 1), value),
            condition={"power": power},
            group=index,
            phase=np.zeros(10, int),
            phases=("heat",),
        )
        for index, (power, value) in enumerate(zip(powers, measured, strict=True))
    )
    measurements = Measurements((channel,), (unit,), ("heater",), records, None, ("r",))
    problem: Any = SimpleNamespace(
        records=records,
        ok=(np.ones((10, 1), bool),) * len(records),
        noise=SimpleNamespace(sigma=np.array([1e-3])),
        measurements=measurements,
    )
    said = tuple(np.full((10, 1), value) for value in predicted)
    return cast(
        "FitResult",
        SimpleNamespace(problem=problem, fitted=tuple(range(len(records))), expected_outputs=said),
    )


def test_the_trend_of_a_temperature_is_in_kelvin_not_in_percent() -> None:
    (trend,) = trends(fitted("temperature", "degC", (300.0, 310.0, 320.0), (300.0, 305.0, 310.0)))
    assert (trend.unit, trend.measured, trend.predicted) == ("K", pytest.approx(20.0), pytest.approx(10.0))
    assert trend_text(trend).startswith("measured temperature rises 20 K from ")
    assert trend_text(trend).endswith("the model says it rises 10 K")
    assert trend.matters
    assert trend.document()["unit"] == "K"


def test_the_trend_of_a_quantity_with_a_true_zero_is_in_percent() -> None:
    (trend,) = trends(fitted("flow", "m^3/s", (1.0, 1.1, 1.2), (1.0, 1.0, 1.0)))
    assert (trend.unit, trend.measured) == ("1", pytest.approx(0.2))
    assert "measured flow rises 20 % from " in trend_text(trend)
    assert trend_text(trend).endswith("the model says it stays the same")


def test_changes_that_differ_are_shown_with_the_digits_in_which_they_do() -> None:
    """ "rises 50 %, the model says it rises 50 %" stood beside 4 sigma."""
    (trend,) = trends(fitted("flow", "m^3/s", (1.0, 1.1, 1.2), (1.0, 1.1005, 1.201)))
    assert "measured flow rises 20 % from " in trend_text(trend)
    assert trend_text(trend).endswith("the model says it rises 20.1 %")
    (trend,) = trends(fitted("flow", "m^3/s", (1.0, 1.1111, 1.2222), (1.0, 1.1111, 1.2222)))
    assert trend_text(trend).endswith("the model says it rises 22 %")


def test_the_sign_of_a_change_that_the_model_does_not_make_is_not_wrong() -> None:
    """ "Rises 4.8 %, the model says it stays the same" was followed by "the wrong direction"."""
    measured, predicted = (1.0, 1.024, 1.048), (1.0, 1.0 - 5e-6, 1.0 - 1e-5)
    (trend,) = trends(fitted("flow", "m^3/s", measured, predicted))
    assert trend.significant
    assert trend_text(trend).endswith("the model says it stays the same")
    assert not trend.wrong_sign
    (trend,) = trends(fitted("flow", "m^3/s", measured, (1.0, 0.999, 0.998)))
    assert not trend.wrong_sign  # hardly any change is none, not one in the wrong direction
    (trend,) = trends(fitted("flow", "m^3/s", measured, (1.0, 0.976, 0.952)))
    assert trend.wrong_sign


def test_two_records_do_not_show_by_how_much_others_would_differ() -> None:
    fit = fitted("flow", "m^3/s", (1.0, 1.1, 1.2), (1.0, 0.9, 0.8))
    (trend,) = trends(cast("FitResult", SimpleNamespace(**{**vars(fit), "fitted": (0, 2)})))
    assert (trend.z, trend.wrong_sign) == (0.0, False)


@pytest.mark.parametrize("count", [4, 12, 28])
def test_what_differs_from_record_to_record_is_not_taken_for_a_trend(count: int) -> None:
    """A gauge off by thirty sigmas of a reading in each record: |z| > 3 has a probability of 0.27 %."""
    rng = np.random.default_rng(20)
    powers = np.linspace(20.0, 60.0, count)
    found = []
    for _ in range(2000):
        readings = tuple(300.0 + 0.03 * rng.standard_normal(count))
        fit = fitted("temperature", "degC", readings, (300.0,) * count, tuple(powers))
        found.append(trends(fit)[0].z)
    assert np.mean(np.abs(found) > 3.0) < 0.008
    assert np.std(found) == pytest.approx(1.0, abs=0.06)


def test_what_a_command_does_is_not_taken_for_the_effect_of_a_temperature() -> None:
    """A motor heats up as its voltage is raised: the speed seemed to depend on the temperature alone."""
    rng = np.random.default_rng(3)
    volts = np.repeat([6.0, 12.0, 20.0], 6)
    warm = 20.0 + volts + 4.0 * rng.standard_normal(volts.size)
    speed = 10.0 * volts + 0.01 * rng.standard_normal(volts.size)
    fit: Any = fitted("speed", "rad/s", tuple(speed), tuple(9.9 * volts), tuple(warm))
    records = tuple(
        replace(one, inputs=np.array([[0.0], [volt]]))
        for one, volt in zip(fit.problem.records, volts, strict=True)
    )
    rig = SimpleNamespace(channels={}, actuators={"heater": SimpleNamespace(display_unit="V")})
    (alone,) = trends(fit)
    fit.problem.records = records
    fit.problem.measurements = replace(fit.problem.measurements, records=records, rig=cast("Any", rig))
    (beside,) = trends(fit)
    assert alone.measured > 0.3
    assert abs(beside.measured) < 0.01
    assert abs(beside.predicted) < 0.01
    assert not beside.significant


def test_a_command_that_goes_with_the_variable_is_no_second_explanation() -> None:
    fit: Any = fitted("flow", "m^3/s", (1.0, 1.1, 1.2, 1.3), (1.0,) * 4, (20.0, 40.0, 60.0, 80.0))
    fit.problem.records = tuple(
        replace(one, inputs=np.array([[0.0], [float(k)]])) for k, one in enumerate(fit.problem.records)
    )
    rig = SimpleNamespace(channels={}, actuators={"heater": SimpleNamespace(display_unit="W")})
    fit.problem.measurements = replace(
        fit.problem.measurements, records=fit.problem.records, rig=cast("Any", rig)
    )
    (trend,) = trends(fit)
    assert trend.measured == pytest.approx(0.3)
