"""Phases of low crest factor: what the signal is, and that its peaks are low."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigctl.frequency.multisine import low_crest_phases


def signal(harmonics: list[int], phases: tuple[float, ...], points: int) -> np.ndarray:
    """One period of rms 1, summed in time, which the code does by transforms."""
    angle = 2.0 * np.pi * np.arange(points) / points
    waves = [np.cos(order * angle + phase) for order, phase in zip(harmonics, phases, strict=True)]
    return math.sqrt(2.0 / len(harmonics)) * np.sum(waves, axis=0)


@given(st.lists(st.integers(1, 60), min_size=1, max_size=40, unique=True).map(sorted))
def test_the_crest_factor_is_that_of_the_signal_and_no_higher_than_schroeders(harmonics: list[int]) -> None:
    found = low_crest_phases(harmonics)
    course = signal(harmonics, found.values, 64 * harmonics[-1] + 1)
    assert float(np.sqrt(np.mean(course**2))) == pytest.approx(1.0, abs=1e-6)
    assert float(np.abs(course).max()) == pytest.approx(found.crest_factor, rel=0.01)
    count = len(harmonics)
    schroeder = tuple(-np.pi * k * (k + 1) / count for k in range(count))
    of_schroeder = float(np.abs(signal(harmonics, schroeder, 64 * harmonics[-1] + 1)).max())
    assert 1.4 < found.crest_factor <= of_schroeder * 1.01


@pytest.mark.parametrize("harmonics", [range(1, 21), range(5, 50), range(1, 400)])
def test_neighbouring_lines_come_near_a_single_sine(harmonics: range) -> None:
    """Random phases give 2.5 to 3.5; the best known for such lines lie about 1.4."""
    assert low_crest_phases(list(harmonics)).crest_factor < 1.52
    random = np.random.default_rng(1).uniform(0.0, 2.0 * np.pi, len(harmonics))
    assert np.abs(signal(list(harmonics), tuple(random), 20_001)).max() > 2.0


def test_a_seed_gives_another_signal_and_always_the_same() -> None:
    found = [low_crest_phases(range(1, 31), seed) for seed in (None, 1, 1, 2)]
    assert found[1] == found[2]
    assert len({one.values for one in found}) == 3
    assert all(one.crest_factor < 1.8 for one in found)
    # to the last digit that is kept, on every computer
    assert found[1].values[:3] == PHASES_OF_SEED_1


PHASES_OF_SEED_1 = (0.003875, 2.488842, 4.154011)


def test_thousands_of_harmonics_are_computed_once() -> None:
    assert low_crest_phases(range(1, 300)) is low_crest_phases(list(range(1, 300)))
