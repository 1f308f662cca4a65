"""How far a clock is off, from edges that a channel sees: found within its uncertainty, or refused."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from rigctl.errors import RigctlError
from rigctl.runner.edge_offset import Edge, Offset, offset_of

Floats = NDArray[np.float64]
HOLD, REPEATS = 1.0, 12


def edges(spread: float, uncertainty: float, rng: np.random.Generator) -> tuple[list[Edge], list[float]]:
    """Edges as a bench confirms them, and the times at which the output really switched."""
    times = HOLD + np.cumsum([HOLD + spread * (0.618 * k % 1.0) for k in range(2 * REPEATS)])
    known = [Edge(t - uncertainty, t + uncertainty, k % 2 == 0) for k, t in enumerate(times)]
    return known, [float(t + uncertainty * rng.uniform(-1.0, 1.0)) for t in times]


def read(
    behind: float, period: float, switched: Sequence[float], phase: float, levels: Sequence[float]
) -> tuple[Floats, Floats]:
    """Readings of the output by a clock that is behind."""
    dated = np.arange(phase * period, switched[-1] + HOLD, period)
    on = np.searchsorted(switched, dated + behind, side="right") % 2
    return dated, np.where(on == 1, levels[1], levels[0])


def measured(*arguments: Any) -> Offset:
    return offset_of("trigger", *arguments)


@given(
    behind=st.floats(-0.2, 0.2),
    period=st.floats(0.005, 0.1),
    phase=st.floats(0.0, 1.0),
    uncertainty=st.floats(0.0, 0.02),
    levels=st.sampled_from([(0.0, 1.0), (5.0, -3.0), (293.15, 293.65)]),
    jitter=st.sampled_from([0.0, 0.2]),
    seed=st.integers(0, 10_000),
)
def test_a_planted_offset_is_found_within_twice_its_uncertainty(
    behind: float,
    period: float,
    phase: float,
    uncertainty: float,
    levels: tuple[float, float],
    jitter: float,
    seed: int,
) -> None:
    """Whatever the phase of the readings; the uncertainty is one of 95 %, and small beside the period."""
    rng = np.random.default_rng(seed)
    known, switched = edges(period, uncertainty, rng)
    dated, values = read(behind, period, switched, phase, levels)
    dated = dated + jitter * period * rng.uniform(-0.5, 0.5, dated.size)
    values = values + 0.01 * (levels[1] - levels[0]) * rng.standard_normal(values.size)
    found = measured(dated, values, known, HOLD)
    assert abs(found.behind - behind) < 2.0 * found.uncertainty
    assert found.uncertainty < 0.5 * period + 2.0 * uncertainty
    assert found.edges == 2 * REPEATS


def test_the_uncertainty_is_one_of_95_percent() -> None:
    """Of two hundred offsets; the spread of the holds makes more of them fall within it."""
    rng = np.random.default_rng(4)
    within = 0
    for _ in range(200):
        behind, phase, period = rng.uniform(-0.2, 0.2), rng.uniform(), rng.uniform(0.01, 0.1)
        known, switched = edges(period, 0.002, rng)
        found = measured(*read(behind, period, switched, phase, (0.0, 1.0)), known, HOLD)
        within += abs(found.behind - behind) < found.uncertainty
    assert within >= 190


def test_edges_always_at_the_same_place_between_two_readings_say_no_more_than_that() -> None:
    """Their scatter is zero, and the offset may be anywhere within half a period."""
    known, switched = edges(0.0, 0.0, np.random.default_rng(1))
    found = measured(*read(0.0, 0.1, switched, 0.5, (0.0, 1.0)), known, HOLD)
    assert found.uncertainty == pytest.approx(0.05)
    assert abs(found.behind) <= found.uncertainty


def test_a_channel_that_does_not_respond_is_named() -> None:
    known, switched = edges(0.05, 0.0, np.random.default_rng(1))
    dated, values = read(0.0, 0.05, switched, 0.3, (0.0, 0.0))
    noise = 0.1 * np.random.default_rng(2).standard_normal(values.size)
    for one in (values, values + noise):
        with pytest.raises(RigctlError, match="trigger does not respond to the output"):
            measured(dated, one, known, HOLD)
    with pytest.raises(RigctlError, match="trigger does not respond to the output"):
        measured(np.empty(0), np.empty(0), known, HOLD)


def test_a_channel_behind_a_lag_is_refused() -> None:
    """How late it is would be the lag's, not the clock's."""
    known, switched = edges(0.05, 0.0, np.random.default_rng(1))
    dated, values = read(0.0, 0.05, switched, 0.3, (0.0, 1.0))
    lagged, state = np.empty_like(values), 0.0
    for k, target in enumerate(values):
        state += (target - state) * (1.0 - np.exp(-0.05 / 0.1))
        lagged[k] = state
    with pytest.raises(RigctlError, match="trigger responds gradually"):
        measured(dated, lagged, known, HOLD)


def test_an_offset_beyond_a_quarter_of_the_hold_is_refused() -> None:
    known, switched = edges(0.05, 0.0, np.random.default_rng(1))
    for behind in (0.255, -0.3, 0.5):
        with pytest.raises(RigctlError, match="off by"):
            measured(*read(behind, 0.05, switched, 0.3, (0.0, 1.0)), known, HOLD)
