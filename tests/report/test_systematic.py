"""Errors without the noise, and parameters in everyday units of a bench."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from made_fit import RECORDS, UNITS, made_fit, made_noise
from rigctl.analysis.diagnosis_result import FoundParameter
from rigctl.answers.errors import error_text
from rigctl.answers.everyday_units import everyday
from rigctl.answers.findings.systematic_error import falls, left_of_fit
from rigctl.model import load_model
from rigctl.model.fit.errors import ChannelError
from rigctl.model.fit.fit import FitResult
from rigctl.model.measured.record import Measurements
from rigctl.report.analysis.overlay import fall_plot, running_mean

TEXTBOOK = Path(__file__).parents[2] / "models" / "hl32-textbook.yaml"
#: of the position, in SI: a third of the noise of one reading
OFF = 0.03


def before_and_after(correlation: float = 0.0) -> tuple[FitResult, FitResult]:
    """A model with a constant error, and one without, on the same readings."""
    before = made_fit(made_noise(correlation), 3, lambda place, times: np.full(times.size, OFF))
    after = tuple(outputs - np.array([OFF, 0.0]) for outputs in before.outputs)
    return before, replace(before, outputs=after)


def test_a_reduction_of_the_error_below_the_noise_is_shown() -> None:
    before, after = before_and_after()
    rmse = [fit.errors["position"].rmse for fit in (before, after)]
    assert 1.0 < rmse[0] / rmse[1] < 1.1  # which looks insignificant
    position, pressure = falls([before, after], [left_of_fit(before), {}])
    readings = RECORDS * before.outputs[0].shape[0]
    assert position.sizes == (pytest.approx(OFF / 0.1 * readings**0.5, rel=0.2), 0.0)
    assert position.amounts[0] == pytest.approx(1e3 * OFF, rel=0.2)  # mm
    assert position.changed
    assert position.sigmas(1) == "within the noise"
    assert position.amount(1) == ""
    assert (pressure.changed, pressure.sizes) == (False, (0.0, 0.0))


def test_slow_noise_is_not_a_systematic_error() -> None:
    for seed in range(5):
        fit = made_fit(made_noise(0.9), seed)
        hair = replace(fit, outputs=tuple(outputs + 1e-4 for outputs in fit.outputs))
        assert not any(one.changed for one in falls([fit, hair], [{}, {}]))


def test_each_size_is_that_of_its_model_alone() -> None:
    before, after = before_and_after()
    alone = next(one for one in falls([before], [{"position": 30.0}]) if one.channel == "position")
    both = falls([before, after], [{"position": 30.0}, {"position": 20.0}])
    position = next(one for one in both if one.channel == "position")
    assert position.sizes == (30.0, 20.0)
    assert (position.sizes[0], position.amounts[0]) == (alone.sizes[0], alone.amounts[0])
    assert position.amounts[1] > 0.0


def test_a_fall_within_the_noise_is_named_as_one() -> None:
    position, _ = falls(before_and_after(), [{}, {}])
    assert position.sizes == (0.0, 0.0)
    assert position.changed
    text = error_text([position]).partition("; the noise of")[0]
    assert text == "within the noise before and after, smaller now, position"


def test_what_a_test_rejects_is_not_within_the_noise() -> None:
    before, _ = before_and_after()
    quiet = [replace(one, guessed=False) for one in falls([before], [{}])]
    assert error_text(quiet) == "within the noise on every channel"
    assert error_text(quiet, "test 'score', p < 1e-6") == (
        "no larger than the noise on any channel, but not random (test 'score', p < 1e-6)"
    )


@given(
    noise=st.floats(1e-4, 10.0), off=st.floats(0.0, 100.0), share=st.floats(0.0, 1.0), seed=st.integers(0, 9)
)
def test_a_systematic_error_is_never_larger_than_the_error(
    noise: float, off: float, share: float, seed: int
) -> None:
    """And the same where the noise is negligible; in the unit of the channel."""
    rng = np.random.default_rng(seed)
    error = off * rng.standard_normal(400)
    rmse = float(np.sqrt(np.mean(error**2)))
    made = ChannelError(rmse, 0.0, 0.0, noise, rmse / noise, (rmse / noise) ** 2, 0.9, error.size)
    most = (max((rmse / noise) ** 2 - 1.0, 0.0) * error.size) ** 0.5
    fit = SimpleNamespace(
        errors={"position": made},
        problem=SimpleNamespace(
            measurements=SimpleNamespace(outputs=("position",), units=("mm",), titles={}),
            noise=SimpleNamespace(
                channels=[SimpleNamespace(name="position", guessed=False, own_scale=False)]
            ),
        ),
    )
    (position,) = falls([fit], [{"position": share * most}])  # type: ignore[list-item]
    assert position.amounts[0] <= 1e3 * rmse * (1.0 + 1e-9)
    if rmse > 100.0 * noise and not position.within(0):
        assert position.amounts[0] == pytest.approx(1e3 * rmse, rel=1e-3)


def test_a_residual_below_the_noise_is_drawn_as_means_that_make_it_visible() -> None:
    before, after = before_and_after()
    plot = fall_plot([("before", before), ("after", after)], 0, "o", "a record", ["position"])
    assert "as means of 3 readings" in plot.caption
    worse, better, above, below = (trace.y for trace in plot.panels[1].traces)
    assert np.nanmean(worse - better) == pytest.approx(OFF / 0.1)
    assert above[0] == -below[0] == pytest.approx(2.0 / 3**0.5)
    outside = np.abs(better) > above[0]
    assert 0.01 < outside.mean() < 0.12  # 1 of 20
    coarse = made_fit(made_noise(), 3, lambda place, times: np.full(times.size, 0.5))
    alone = fall_plot([("model", coarse)], 0, "o", "a record", ["position"])
    assert alone.caption == "a record"
    assert np.array_equal(alone.panels[1].traces[0].y, coarse.normalised_error(0)[:, 0])


def test_a_running_mean_stays_within_its_phase_and_skips_missing_values() -> None:
    values = np.array([1.0, np.nan, 4.0, 10.0, 20.0])
    found = running_mean(values, np.array([0, 0, 0, 1, 1]), 3)
    assert found.tolist() == [1.0, 2.5, 4.0, 15.0, 15.0]


@pytest.fixture
def bench() -> Any:
    """A problem of the textbook's bench with records up to 50 bar and 80 degC."""
    condition = {"oil": 353.15, "supply": 50e5}
    records = (
        SimpleNamespace(condition={"oil": 293.15, "supply": 20e5}),
        SimpleNamespace(condition=condition),
    )
    measurements = Measurements(("position",), UNITS[:1], ("valve",), records, None, ("r",))  # type: ignore[arg-type]
    return SimpleNamespace(model=load_model(TEXTBOOK), records=records, measurements=measurements)


def test_a_leak_is_shown_as_a_flow_at_maximum_temperature_and_pressure(bench: Any) -> None:
    leak = bench.model.effect("valve_leakage")
    said = everyday(leak, "conductance", FoundParameter(6.84e-15, "m^3", 6e-17), bench)
    flow, at = re.fullmatch(r"about ([\d.]+) l/min at (.*)", said).groups()  # type: ignore[union-attr]
    assert at == "50 bar, 80 degC"
    viscosity = 9.0e-6 * 835.0  # of an oil of grade 32 at 80 degC, ISO 3448 and its density
    assert float(flow) == pytest.approx(6.84e-15 * 50e5 / viscosity * 6e4, rel=0.1)
    drop = everyday(leak, "conductance", FoundParameter(4e-18, "m^3", 1e-19), bench)
    assert drop.startswith("about 0.16 ml/min")


def test_other_parameters_are_shown_in_everyday_units(bench: Any) -> None:
    drift = bench.model.effect("position_thermal_drift")
    assert (
        everyday(drift, "coefficient", FoundParameter(2.3e-4, "1/K", 1e-6), bench)
        == "about 0.23 % for each 10 K"
    )
    friction = bench.model.effect("coulomb_friction")
    assert everyday(friction, "force", FoundParameter(98.1, "N", 1.0), bench) == "about the weight of 10 kg"
    assert everyday(friction, "force", FoundParameter(-57.0, "N", 2.2), bench) == ""  # no weight
    lag = bench.model.effect("heater_lag")
    assert everyday(lag, "lag", FoundParameter(30.0, "s", 1.0), bench) == ""
