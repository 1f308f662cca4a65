"""The scan for changes: its power, and its false alarms where nothing changes."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from rigctl.monitoring.course import scatter_between, shape_of
from rigctl.monitoring.ranks import neighbours, normal_scores
from rigctl.monitoring.significance import best_possible, critical, scan

Floats = NDArray[np.float64]
ORDER = np.arange(40, dtype=float)


def _correlated(draw: np.random.Generator, count: int, correlation: float = 0.3) -> Floats:
    values = draw.standard_normal(count)
    for k in range(1, count):
        values[k] = correlation * values[k - 1] + np.sqrt(1 - correlation**2) * values[k]
    return values


@pytest.mark.parametrize(
    ("draw", "most"),
    [
        (lambda g, n: g.standard_normal(n), 12),
        (lambda g, n: g.standard_cauchy(n), 12),
        (lambda g, n: np.exp(3.0 * g.standard_normal(n)), 12),
        (_correlated, 12),
    ],
    ids=["normal", "cauchy", "skewed", "correlated"],
)
def test_false_alarms_stay_at_the_level_for_any_distribution_of_the_scatter(draw: object, most: int) -> None:
    """At 5 %, 7.5 alarms are expected in 150 courses; 97 of 100 such tests give 12 or fewer."""
    generator = np.random.default_rng(5)
    alarms = sum(scan(draw(generator, 40), ORDER).p_value < 0.05 for _ in range(150))  # type: ignore[operator]
    assert alarms <= most


@pytest.mark.parametrize("correlation", [0.3, 0.6])
def test_false_alarms_stay_rare_for_correlated_runs(correlation: float) -> None:
    """In 400 courses four alarms are expected at 1 %, and 0.1 where forty quantities share the level."""
    generator = np.random.default_rng(6)
    found = [scan(_correlated(generator, 40, correlation), ORDER).p_value for _ in range(400)]
    assert sum(p < 0.01 for p in found) <= 9
    assert sum(p < 0.00025 for p in found) <= 1


def test_steps_and_ramps_are_detected_soon() -> None:
    noise = np.random.default_rng(2).standard_normal(40)
    for change in (4.0 * (ORDER >= 16), 0.5 * np.maximum(ORDER - 16, 0.0)):
        found = scan(noise + change, ORDER)
        first = found.first_end(critical(ORDER, found.correlation, 5e-3))
        assert found.p_value < 5e-3
        assert first is not None and 16 < first <= 34


def test_a_single_outlying_run_is_not_a_change() -> None:
    values = np.random.default_rng(3).standard_normal(40)
    values[20] = 1e9
    assert scan(values, ORDER).p_value > 0.05


def test_the_p_value_does_not_depend_on_scale_or_offset() -> None:
    values = np.random.default_rng(4).standard_normal(40)
    assert scan(values, ORDER).p_value == scan(1e-15 * values - 7e-15, ORDER).p_value


def test_runs_at_the_same_position_have_no_change() -> None:
    values = np.r_[np.zeros(20), np.ones(20)] + 0.01 * np.random.default_rng(6).standard_normal(40)
    assert scan(values, np.zeros(40)).p_value > 0.01  # all positions are equal: only a straight line remains
    assert scan(values, ORDER).p_value < 1e-3


def test_too_few_runs_cannot_show_a_change() -> None:
    assert best_possible(np.arange(2.0)) == 1.0
    assert best_possible(np.arange(8.0)) > 0.01 > best_possible(np.arange(20.0))


def test_a_ramp_is_not_taken_for_correlation() -> None:
    noise = np.random.default_rng(7).standard_normal(40)
    for course in (noise, noise + 2.0 * np.maximum(ORDER - 16, 0.0), noise + 50.0 * (ORDER > 9)):
        assert neighbours(course[None, :], normal_scores(course)[None, :])[0] <= 0.3


def test_scatter_between_runs_is_separated_from_their_uncertainty() -> None:
    generator = np.random.default_rng(8)
    own = np.full(400, 1.0)
    alone = generator.standard_normal(400)
    assert (scatter_between(alone, own) or 0.0) < 0.6
    more = scatter_between(alone + 3.0 * generator.standard_normal(400), own)
    assert more == pytest.approx(3.0, rel=0.15)
    assert scatter_between(alone[:4], own[:4]) is None


def test_a_change_is_described_by_its_kind_start_and_values() -> None:
    noise = 0.1 * np.random.default_rng(9).standard_normal(40)
    std = np.full(40, 0.1)
    step = shape_of(2.0 + 5.0 * (ORDER >= 16) + noise, std, ORDER, 0.0)
    assert (step.kind, step.begins) == ("step", 16)
    assert step.before == pytest.approx(2.0, abs=0.1) and step.after == pytest.approx(7.0, abs=0.1)
    growth = shape_of(2.0 + 0.3 * np.maximum(ORDER - 15, 0.0) + noise, std, ORDER, 0.0)
    assert growth.kind == "growth" and abs(growth.begins - 16) <= 1
    assert growth.earliest <= 16 <= growth.latest
    assert growth.after == pytest.approx(9.2, abs=0.2)
