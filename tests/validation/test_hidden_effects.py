"""The effects that the separate bench can hide, compared with those of the library."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rigctl.effects.registry import library
from rigctl.errors import RigctlError
from rigctl.physics.families import find_family
from rigctl_validation.amplitude import Clean
from rigctl_validation.bench.campaign import Campaign, clean_outputs
from rigctl_validation.hidden_effect import SHAPES, hide
from rigctl_validation.hidden_library import HIDDEN_EFFECTS, find_hidden
from rigctl_validation.tiers import acting

LIBRARY = library(find_family("hydraulic_cylinder"))
SMALL = Campaign(temperatures=(70.0,), pressures=(50.0,), chamber_pressures=True)
HIDEABLE = [hidden for hidden in HIDDEN_EFFECTS if hidden.amounts(hidden.typical)]


def largest_change(with_it: Clean, without: Clean) -> dict[str, float]:
    """The largest difference of each channel, in units of its noise."""
    sigma = SMALL.noise.sigma
    pairs = list(zip(with_it, without, strict=True))
    return {
        name: max(float(np.abs(a[name] - b[name]).max()) for (_, a), (_, b) in pairs) / sigma[name]
        for name in pairs[0][0][1]
    }


def test_every_effect_of_the_library_can_be_hidden_within_its_bounds() -> None:
    assert {hidden.effect for hidden in HIDDEN_EFFECTS} == set(LIBRARY)
    for hidden in HIDDEN_EFFECTS:
        effect = LIBRARY[hidden.effect]
        if hidden.base:
            assert set(effect.base) == {hidden.parameter}
            continue
        parameter = effect.parameter(hidden.parameter)
        assert parameter.low <= hidden.typical <= parameter.high
        assert hidden.signs == (1,) or parameter.low < 0.0, hidden.effect


@pytest.mark.parametrize("hidden", acting(), ids=lambda hidden: hidden.effect)
def test_hidden_effects_change_the_data(hidden) -> None:
    plain = clean_outputs(SMALL)
    for sign in hidden.signs:
        amplitude = sign * abs(hidden.typical)
        changes = largest_change(clean_outputs(hide(SMALL, [(hidden, amplitude)], "other")), plain)
        assert max(changes.values()) > 0.5, changes


@pytest.mark.parametrize("hidden", [h for h in HIDEABLE if h.cannot_act], ids=lambda hidden: hidden.effect)
def test_inactive_effects_are_below_the_noise(hidden) -> None:
    changes = largest_change(
        clean_outputs(hide(SMALL, [(hidden, hidden.typical)], "other")), clean_outputs(SMALL)
    )
    assert max(changes.values()) < 0.5, changes
    assert changes["position"] < 0.02


def test_an_amplitude_of_zero_changes_nothing() -> None:
    plain = clean_outputs(SMALL)
    for shape in SHAPES:
        every = hide(SMALL, [(hidden, 0.0) for hidden in HIDEABLE], shape)
        assert max(largest_change(clean_outputs(every), plain).values()) < 1e-3


def test_hidden_effects_on_the_same_parameters_add_up() -> None:
    both = hide(
        SMALL, [(find_hidden("coulomb_friction"), 50.0), (find_hidden("stribeck_friction"), 100.0)], "other"
    )
    assert both.bench.coulomb == pytest.approx(90.0)
    assert both.bench.static == pytest.approx(60.0)


def test_the_piston_gap_leaks_with_the_given_conductance() -> None:
    from rigctl_validation.bench.equations import past_piston

    bench = hide(SMALL, [(find_hidden("piston_leakage"), 5e-15)], "same").bench
    assert past_piston(20e5, 0.03, bench) == pytest.approx(5e-15 * 20e5 / 0.03)


def test_unsupported_hidden_effects_are_refused() -> None:
    with pytest.raises(RigctlError, match="heater_lag"):
        hide(SMALL, [(find_hidden("heater_lag"), 10.0)], "other")
    with pytest.raises(RigctlError, match="coulomb_friction"):
        find_hidden("coulomb")


def test_clean_outputs_have_no_noise_scatter_or_jitter() -> None:
    delayed = hide(SMALL, [(find_hidden("valve_open_delay"), 0.02)], "wrong")
    assert delayed.switching.random
    first, second = clean_outputs(delayed), clean_outputs(replace(delayed, seed=5))
    assert max(largest_change(first, second).values()) == 0.0
