"""The tier ``design``: its trials, and the counting of promises that held and of names that were wrong."""

from __future__ import annotations

import json
from typing import Any

import pytest

from rigctl.validation.designed.rates import design_rates
from rigctl.validation.designed.trial import TWINS, DesignTrial, design_trials
from rigctl.validation.designed.work import DesignOutcome
from rigctl.validation.hidden_effects import find_hidden
from rigctl.validation.outcome import Learnt, TrialOutcome


def outcome(*truth: str, rounds: int = 2, **learnt: Any) -> DesignOutcome:
    found = Learnt(**{"left": (("leak", "drift"),), "probability": 0.95, **learnt})
    return TrialOutcome(
        DesignTrial(truth or ("leak",), 20.0, rounds=rounds), verdict="ambiguous", learnt=found
    )


def rate(name: str, of: str, *made: DesignOutcome) -> tuple[int, int]:
    (found,) = [one for one in design_rates(made) if (one.name, one.of) == (name, of)]
    return found.count, found.trials


def test_trials_are_each_once_and_hide_what_the_bench_has() -> None:
    trials = design_trials()
    assert len({one.name for one in trials}) == len(trials) > 100
    for name in TWINS:
        assert find_hidden(name).amounts(1.0)
    assert {one.rounds for one in trials} == {2, 6}
    assert {one.scenario.kind for one in trials} == {"one", "two"}


def test_a_trial_and_its_outcome_are_read_as_they_were_written() -> None:
    made = outcome("leak", "spring", added=("leak",), gains={"drift": 3.0}, winner="leak", told=True)
    text = json.dumps(made.document())
    assert TrialOutcome.read(json.loads(text), DesignTrial.read) == made


@pytest.mark.parametrize(
    ("added", "alone", "wrong"),
    [(("leak",), 1, 0), (("drift",), 0, 1), ((), 0, 0), (("leak", "drift"), 0, 1)],
)
def test_only_the_truth_alone_counts(added: tuple[str, ...], alone: int, wrong: int) -> None:
    made = outcome(added=added)
    assert rate("one designed set", "the truth alone is named", made) == (alone, 1)
    assert rate("one designed set", "another one is named", made) == (wrong, 1)


def test_a_promise_is_counted_where_it_was_made() -> None:
    kept = outcome(probability=0.85, winner="leak", told=True)
    broken = outcome(probability=0.82, winner="drift", told=True)
    sure = outcome(probability=1.0, winner="leak", told=True)
    never = outcome(probability=None)
    made = (kept, broken, sure, never)
    assert rate("promised with 80% to 90%", "came out", *made) == (1, 2)
    assert rate("promised with 90% to 100%", "came out", *made) == (1, 1)
    assert rate("the campaign leaves a class", "records are proposed", *made) == (3, 4)


def test_learning_may_end_with_a_class_that_nothing_here_tells_apart() -> None:
    def whole(**learnt: Any) -> DesignOutcome:
        return outcome(rounds=6, **learnt)

    name = ("learning to its end", "adequate, the truth or its class")
    assert rate(*name, whole(ended="adequate", added=("leak",))) == (1, 1)
    assert rate(*name, whole(ended="adequate", added=("drift",))) == (0, 1)
    assert rate(*name, whole(ended="adequate")) == (0, 1)
    left = TrialOutcome(
        DesignTrial(("leak",), 20.0, rounds=6),
        verdict="ambiguous",
        effects=("drift",),
        classes=(("drift", "leak"),),
        learnt=Learnt(ended="not_separable"),
    )
    assert rate(*name, left) == (1, 1)
