"""Amplitudes for a requested size, found in few simulations."""

from __future__ import annotations

import numpy as np
import pytest

from rigctl_validation.amplitude import Amplitudes, Clean
from rigctl_validation.bench.campaign import Campaign
from rigctl_validation.hidden_library import find_hidden

SMALL = Campaign(temperatures=(30.0,), pressures=(30.0,))


class Size:
    """The norm of the difference of the positions, in 0.1 mm."""

    def __init__(self) -> None:
        self.calls = 0

    def __call__(self, with_it: Clean, without: Clean) -> float:
        self.calls += 1
        pairs = zip(with_it, without, strict=True)
        return float(np.linalg.norm([(a["position"] - b["position"]) / 1e-4 for (_, a), (_, b) in pairs]))


@pytest.mark.parametrize(
    "effect", ["coulomb_friction", "valve_open_delay", "piston_leakage", "entrained_air"]
)
def test_the_requested_size_is_reached_within_five_percent_in_few_simulations(effect: str) -> None:
    size = Size()
    search = Amplitudes(size)
    for wanted in (6.0, 10.0, 30.0):
        found = search.find(find_hidden(effect), wanted, SMALL)
        assert found.reached
        assert found.size == pytest.approx(wanted, rel=0.051)
    assert size.calls <= 10
    again = search.find(find_hidden(effect), 10.0, SMALL)
    assert again.size == pytest.approx(10.0, rel=0.051)
    assert size.calls <= 10


def test_a_negative_sign_gives_a_negative_amplitude() -> None:
    found = Amplitudes(Size()).find(find_hidden("position_thermal_drift"), 10.0, SMALL, sign=-1)
    assert found.reached
    assert found.value < 0.0


def test_unreachable_sizes_are_reported() -> None:
    found = Amplitudes(Size()).find(find_hidden("pressure_gain"), 6.0, SMALL)
    assert not found.reached
    small = Amplitudes(Size()).find(find_hidden("radiation_loss"), 6.0, SMALL)
    assert not small.reached
    assert 0.0 < small.size < 6.0
