"""Localisation of a misfit: false alarms occur at the nominal rate."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from made_fit import SIZE, made_fit, made_noise
from rigctl.analysis.agreement.localisation import (
    CellMap,
    Place,
    _cells,
    _conditions,
    localise,
    ranges,
    worst_stretches,
)
from rigctl.noise import ChannelNoise, NoiseModel

TRIALS = 150
#: number of alarms at 1 % in TRIALS that chance exceeds in less than one case in a thousand
MOST = 6


def smallest(places: Iterable[Place]) -> float:
    return min(place.p_value for place in places)


def in_hold(size: float, record: int | None = None):
    """A misfit in the hold of one record, or of each."""

    def misfit(place: int, times: np.ndarray) -> np.ndarray:
        return size * ((times >= SIZE) & (times < 2 * SIZE) & (record in (None, place)))

    return misfit


@pytest.mark.parametrize("correlation", [0.0, 0.9])
def test_the_worst_stretch_of_pure_noise_rarely_raises_an_alarm(correlation: float) -> None:
    noise = made_noise(correlation)
    found = [worst_stretches(made_fit(noise, seed)) for seed in range(TRIALS)]
    assert sum(smallest(places) < 0.01 for places in found) <= MOST


@pytest.mark.parametrize("correlation", [0.0, 0.9])
def test_the_worst_range_of_a_channel_in_pure_noise_rarely_raises_an_alarm(correlation: float) -> None:
    noise = made_noise(correlation)
    found = [ranges(made_fit(noise, seed)) for seed in range(TRIALS)]
    assert sum(smallest(places) < 0.01 for places in found) <= MOST


def test_a_stretch_with_a_misfit_is_named() -> None:
    first = worst_stretches(made_fit(made_noise(0.6), 3, in_hold(0.4, record=1)))[0]
    assert first.label == "position in hold of r/2"
    assert first.p_value < 1e-6


def test_a_poorly_known_noise_makes_a_stretch_less_significant() -> None:
    known, guessed = (
        worst_stretches(made_fit(made_noise(0.0, degrees), 3, in_hold(0.12, record=1)))[0].p_value
        for degrees in (0, 20)
    )
    assert known < 0.01 < guessed


def test_a_constant_error_of_a_coarse_converter_at_rest_is_not_a_misfit() -> None:
    """With a coarse converter, the error is the same for all samples at rest."""
    fine = ChannelNoise("pressure", 0.1)
    coarse = NoiseModel((ChannelNoise("position", 0.1, step=0.2, bias=0.2), fine), 1.0)
    assert smallest(worst_stretches(made_fit(coarse, 3, in_hold(0.2), still=True))) > 0.01
    assert smallest(worst_stretches(made_fit(coarse, 3, in_hold(0.2)))) < 1e-6


def test_the_p_value_of_the_worst_place_allows_for_the_number_of_places() -> None:
    """Forty places of one cell each, pure noise."""
    draws = np.random.default_rng(1).standard_normal((4000, 40))
    places = [np.arange(40)[:, None] == k for k in range(40)]
    wrong = 0
    for trial in range(TRIALS):
        cells = CellMap(np.random.default_rng(trial).standard_normal((40, 1)), draws)
        wrong += min(cells.p_value(place) for place in places) < 0.01
    assert wrong <= MOST


@pytest.mark.parametrize("drawn", [True, False])
def test_a_place_with_a_misfit_is_significant(drawn: bool) -> None:
    rng = np.random.default_rng(1)
    z = rng.standard_normal((40, 1))
    z[7] = 9.0
    cells = CellMap(z, rng.standard_normal((4000, 40)) if drawn else np.empty((0, 40)))
    here = np.arange(40)[:, None] == 7
    assert cells.p_value(here) < 1e-6
    assert cells.p_value(~here) > 0.05
    assert cells.p_value(np.zeros_like(here)) == 1.0


def made_regions() -> tuple[Any, CellMap]:
    """Twelve records in as many groups at two temperatures, with phases that are not told apart."""
    fit = made_fit(made_noise(), 3, in_hold(0.4))
    records = [replace(one, condition={"oil": 293.15 + (k > 0)}) for k, one in enumerate(fit.problem.records)]
    fit.problem.records = tuple(records)  # type: ignore[misc]
    regions = SimpleNamespace(labels=(("all", "position"), ("all", "pressure")), groups=tuple(range(12)))
    return SimpleNamespace(fit=fit, regions=regions), CellMap(np.full((12, 2), 5.0), np.empty((0, 24)))


def test_a_cell_of_all_phases_together_is_named_by_its_channel() -> None:
    assert [place.label for place in _cells(*made_regions())] == ["position", "pressure"]


def test_conditions_with_the_same_text_are_named_with_their_records() -> None:
    labels = [place.label for place in _conditions(*made_regions())]
    assert labels[:3] == ["oil 20 degC", "oil 21 degC (r/2)", "oil 21 degC (r/3)"]
    assert len(set(labels)) == 12


def test_a_single_phase_is_no_place() -> None:
    """It was listed with all of the error."""
    assert {place.by for place in localise(*made_regions())} == {"channel", "cell", "condition", "state"}
