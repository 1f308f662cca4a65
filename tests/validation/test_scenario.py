"""Trials of the benchmark: each determined by its description, and all distinct."""

from __future__ import annotations

import json
from collections import Counter

import numpy as np
import pytest

from rigctl_validation.bench.campaign import clean_outputs, simulate_records
from rigctl_validation.scenario import NOISES, Scenario, Wanted
from rigctl_validation.tiers import acting, scenarios

SMALL = {"temperatures": (20.0, 60.0), "pressures": (30.0,), "repeated": 1}
ONE = Scenario("one", (Wanted("coulomb_friction", 10.0),), **SMALL)


def test_a_scenario_survives_json() -> None:
    scenario = Scenario("removed", (Wanted("constant_load", 30.0, -1),), "wrong", "all", True, 8, True, 7)
    assert Scenario.read(json.loads(json.dumps(scenario.document()))) == scenario
    assert scenario.left_out == ("constant_load",)
    assert ONE.left_out == ()


def test_the_kind_of_a_scenario_fixes_its_number_of_effects() -> None:
    with pytest.raises(ValueError, match="two"):
        Scenario("two", (Wanted("constant_load", 6.0),))


@pytest.mark.parametrize("noise", NOISES)
def test_equal_scenarios_make_identical_data_and_another_seed_other_data(noise) -> None:
    scenario = Scenario("one", (Wanted("coulomb_friction", 10.0),), noise=noise, **SMALL)
    first, second = (simulate_records(scenario.campaign((60.0,))) for _ in range(2))
    other = simulate_records(Scenario("one", scenario.hidden, noise=noise, seed=1, **SMALL).campaign((60.0,)))
    for a, b, c in zip(first, second, other, strict=True):
        for name, values in a.channels.items():
            assert np.array_equal(values, b.channels[name])
            assert not np.array_equal(values, c.channels[name])


def test_records_are_the_clean_outputs_plus_the_specified_noise() -> None:
    campaign = Scenario("nothing", noise="coloured", **SMALL).plain
    clean, records = clean_outputs(campaign), simulate_records(campaign)
    assert len(clean) == len(records) == 3
    errors = np.concatenate(
        [r.channels["position"] - c["position"] for r, (_, c) in zip(records, clean, strict=True)]
    )
    assert errors.std() == pytest.approx(1e-4, rel=0.15)
    assert np.corrcoef(errors[1:], errors[:-1])[0, 1] == pytest.approx(0.6, abs=0.1)


def test_repeated_records_differ_in_noise_only() -> None:
    records = simulate_records(Scenario("nothing", **SMALL).plain)
    assert records[0].setting == records[2].setting
    between = records[1].channels["position"] - records[2].channels["position"]
    assert 1e-4 < between.std() < 2e-4


def test_tiers_contain_every_kind_and_no_scenario_twice() -> None:
    for tier in ("quick", "full"):
        found = scenarios(tier)
        assert len({scenario.name for scenario in found}) == len(found)
        assert {scenario.kind for scenario in found} == {"nothing", "one", "two", "removed"}
        assert found == scenarios(tier)


def test_the_full_tier_hides_every_effect_at_every_size() -> None:
    full = scenarios("full")
    ones = Counter((s.truth[0], s.hidden[0].size) for s in full if s.kind == "one" and s.shape == "other")
    assert set(ones) == {(hidden.effect, size) for hidden in acting() for size in (6.0, 10.0, 30.0)}
    assert min(ones.values()) >= 4
    nothing = [s for s in full if s.kind == "nothing"]
    assert {s.noise for s in nothing} == set(NOISES)
    assert sum(s.noise_known for s in nothing) >= 50
    assert len(nothing) >= 250
    assert len(full) <= 1000
