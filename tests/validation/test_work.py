"""Single trials of the benchmark, from the bench to the verdict."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from rigctl.engine.result_cache import RESULTS_VARIABLE
from rigctl_validation.outcome import Outcome
from rigctl_validation.scenario import Scenario, Wanted
from rigctl_validation.work import carry_out

SMALL = Scenario("nothing", repeated=1, temperatures=(20.0, 80.0), pressures=(20.0, 50.0))


@pytest.fixture(scope="module")
def large() -> Outcome:
    """The trial of a large effect with the law of the library."""
    return carry_out(replace(SMALL, kind="one", hidden=(Wanted("valve_leakage", 40.0),), shape="same"))


def test_a_large_effect_is_found_at_its_requested_size(large: Outcome) -> None:
    outcome = large
    assert outcome.sizes == (pytest.approx(40.0, rel=0.051),)
    assert outcome.right
    assert outcome.first == "valve_leakage"
    assert outcome.rival_cosine is not None and 0.0 < outcome.rival_cosine < 1.0
    by_its_cosine = outcome.sizes[0] * ((1.0 - outcome.rival_cosine) / 2.0) ** 0.5
    assert outcome.separation is not None and 0.0 < outcome.separation <= 1.03 * by_its_cosine
    assert [interval.parameter for interval in outcome.intervals] == ["conductance"]
    assert Outcome.read(outcome.document(), Scenario.read) == outcome


def test_two_effects_that_resemble_a_third_are_both_named() -> None:
    """Both look like a constant delay of the valve."""
    hidden = (Wanted("valve_delay_thermal", 30.0), Wanted("position_backlash", 30.0))
    outcome = carry_out(replace(SMALL, kind="two", hidden=hidden, chamber_pressures=True))
    assert outcome.exact
    assert min(outcome.beside) > 20.0
    # the law of the delay absorbs little of the backlash, within its tolerance
    assert all(
        15.0 < beyond < 1.2 * beside
        for beyond, beside in zip(outcome.beyond_laws, outcome.beside, strict=True)
    )


def test_a_trial_is_repeated_with_the_amplitude_found_before(
    large: Outcome, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, scenario = large, large.scenario

    def searched_again(*_: object) -> None:
        raise AssertionError("known from the first time")

    monkeypatch.setattr("rigctl_validation.work.hidden_amplitudes", searched_again)
    monkeypatch.setattr("rigctl_validation.work.likeness", searched_again)
    again = carry_out(scenario, {scenario.name: first})
    assert replace(again, seconds=first.seconds) == first
    unreached = replace(first, untested="no amplitude of valve_leakage has the size wanted", verdict=None)
    assert not carry_out(scenario, {scenario.name: unreached}).counts
    other = replace(first, scenario=replace(scenario, temperatures=(20.0, 70.0)))
    assert other.scenario.name == scenario.name
    with pytest.raises(AssertionError, match="known from the first time"):  # another campaign of this name
        carry_out(scenario, {scenario.name: other})
    pair = replace(first, beside=(12.0, 11.0))
    with pytest.raises(AssertionError, match="known from the first time"):  # a part is unknown
        carry_out(scenario, {scenario.name: pair})


def test_noise_may_be_given_instead_of_estimated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(RESULTS_VARIABLE, str(tmp_path / "results"))
    outcome = carry_out(replace(SMALL, noise_known=True))
    assert outcome.verdict == "adequate"
    assert not outcome.effects
    assert not (tmp_path / "results").exists(), "a trial is made once: what it fits is of no use to anybody"


def test_an_effect_that_cannot_reach_its_size_is_not_counted() -> None:
    outcome = carry_out(replace(SMALL, kind="one", hidden=(Wanted("thermocouple_offset", 30.0),)))
    assert not outcome.counts
    assert "thermocouple_offset" in outcome.untested
