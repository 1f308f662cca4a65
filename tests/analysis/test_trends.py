"""The description of a quantity's change over the operating point."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from rigctl.analysis.trends import trends
from rigctl.model.fit.fit import FitResult
from rigctl.model.measured.record import MeasuredRecord, Measurements

POWERS = (20.0, 40.0, 60.0)


def fitted(channel: str, unit: str, measured: tuple[float, ...], predicted: tuple[float, ...]) -> FitResult:
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
        for index, (power, value) in enumerate(zip(POWERS, measured, strict=True))
    )
    measurements = Measurements((channel,), (unit,), ("heater",), records, None, ("r",))
    problem: Any = SimpleNamespace(
        records=records,
        ok=(np.ones((10, 1), bool),) * len(records),
        noise=SimpleNamespace(sigma=np.array([1e-3])),
        measurements=measurements,
    )
    said = tuple(np.full((10, 1), value) for value in predicted)
    return cast("FitResult", SimpleNamespace(problem=problem, fitted=(0, 1, 2), expected_outputs=said))


def test_the_trend_of_a_temperature_is_in_kelvin_not_in_percent() -> None:
    (trend,) = trends(fitted("temperature", "degC", (300.0, 310.0, 320.0), (300.0, 305.0, 310.0)))
    assert (trend.unit, trend.measured, trend.predicted) == ("K", pytest.approx(20.0), pytest.approx(10.0))
    assert trend.text.startswith("measured temperature rises 20 K from ")
    assert trend.text.endswith("the model says it rises 10 K")
    assert trend.matters
    assert trend.document()["unit"] == "K"


def test_the_trend_of_a_quantity_with_a_true_zero_is_in_percent() -> None:
    (trend,) = trends(fitted("flow", "m^3/s", (1.0, 1.1, 1.2), (1.0, 1.0, 1.0)))
    assert (trend.unit, trend.measured) == ("1", pytest.approx(0.2))
    assert "measured flow rises 20 % from " in trend.text
    assert trend.text.endswith("the model says it stays the same")


def test_changes_that_differ_are_shown_with_the_digits_in_which_they_do() -> None:
    """ "rises 50 %, the model says it rises 50 %" stood beside 4 sigma."""
    (trend,) = trends(fitted("flow", "m^3/s", (1.0, 1.1, 1.2), (1.0, 1.1005, 1.201)))
    assert "measured flow rises 20 % from " in trend.text
    assert trend.text.endswith("the model says it rises 20.1 %")
    (trend,) = trends(fitted("flow", "m^3/s", (1.0, 1.1111, 1.2222), (1.0, 1.1111, 1.2222)))
    assert trend.text.endswith("the model says it rises 22 %")
