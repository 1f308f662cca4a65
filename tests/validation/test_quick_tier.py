"""The quick tier of the benchmark, whole: how often a diagnosis is right, on campaigns that it did not make.

Seeds are fixed, so the outcomes are too; what is asked leaves room for what another processor rounds.
"""

from __future__ import annotations

import pytest

from rigctl.validation.outcome import Outcome
from rigctl.validation.parallel import attempt
from rigctl.validation.scenario import Scenario
from rigctl.validation.tiers import scenarios
from rigctl.validation.work import carry_out

#: parts, so that two processes can share them
PARTS = 6


def wrong(outcome: Outcome) -> bool:
    """A confident answer that is not so: the one thing that must not happen."""
    if outcome.failure:
        return True
    if outcome.scenario.kind == "nothing":
        return outcome.verdict != "adequate"
    if outcome.scenario.kind == "removed":
        return outcome.verdict == "adequate"
    return outcome.accepted and not outcome.right


def missed(outcome: Outcome) -> bool:
    """What is hidden was not found, alone or with its twins."""
    if outcome.scenario.kind == "one":
        return outcome.first not in outcome.scenario.truth and not outcome.right
    return outcome.scenario.kind == "two" and not outcome.exact


@pytest.mark.parametrize("part", range(PARTS))
def test_the_quick_tier_names_nothing_wrong_and_misses_little(part: int) -> None:
    chosen: tuple[Scenario, ...] = scenarios("quick")[part::PARTS]
    outcomes = [attempt(carry_out, scenario) for scenario in chosen]
    made = [outcome for outcome in outcomes if outcome.counts]
    assert len(made) >= len(chosen) - 1
    assert [outcome.scenario.name for outcome in made if wrong(outcome)] == []
    assert len([outcome.scenario.name for outcome in made if missed(outcome)]) <= 1
