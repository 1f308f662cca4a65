"""Rates of the benchmark: Wilson's bounds, and what counts as right."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigctl_validation.figures import wilson
from rigctl_validation.outcome import Claim, Interval, Outcome, TrialOutcome
from rigctl_validation.rates import confusion, figures, rates
from rigctl_validation.scenario import Scenario, Wanted
from rigctl_validation.shape_rates import shape_rates
from rigctl_validation.tables import confusion_table, markdown, rates_table

NOTHING = Scenario("nothing")
ONE = Scenario("one", (Wanted("coulomb_friction", 10.0),))
TWO = Scenario("two", (Wanted("coulomb_friction", 10.0), Wanted("piston_leakage", 10.0)))
REMOVED = Scenario("removed", (Wanted("coulomb_friction", 30.0),))


def one(verdict="missing_effect", effects=("coulomb_friction",), **rest) -> Outcome:
    given = {"first": effects[0] if effects else None, "rival_cosine": 0.5, "separation": 5.0, **rest}
    return Outcome(ONE, verdict=verdict, effects=effects, **given)


def test_wilson_intervals_agree_with_published_values() -> None:
    assert wilson(0, 10) == pytest.approx((0.0, 0.2775), abs=1e-4)
    assert wilson(5, 10) == pytest.approx((0.2366, 0.7634), abs=1e-4)
    assert wilson(10, 10) == pytest.approx((0.7225, 1.0), abs=1e-4)
    assert wilson(0, 0) == (0.0, 1.0)


@given(st.integers(1, 10_000).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_a_wilson_interval_contains_the_observed_rate(pair: tuple[int, int]) -> None:
    count, trials = pair
    low, high = wilson(count, trials)
    assert 0.0 <= low <= count / trials + 1e-12
    assert count / trials - 1e-12 <= high <= 1.0


def by_name(outcomes: list[Outcome]) -> dict[tuple[str, str], tuple[int, int]]:
    return {(rate.name, rate.of): (rate.count, rate.trials) for rate in rates(outcomes)}


def test_false_alarms_are_counted_by_noise_and_include_failures() -> None:
    outcomes = [
        Outcome(NOTHING, verdict="adequate"),
        Outcome(NOTHING, verdict="ambiguous", effects=("coulomb_friction",)),
        Outcome(NOTHING, failure="no convergence"),
        Outcome(Scenario("nothing", noise_known=True), verdict="adequate"),
    ]
    found = by_name(outcomes)
    assert found["false alarm, nothing hidden", "noise estimated"] == (2, 3)
    assert found["false alarm, nothing hidden", "noise known"] == (0, 1)


def test_a_class_that_contains_the_truth_counts_as_right() -> None:
    twins = (("coulomb_friction", "stribeck_friction"),)
    ambiguous = one("ambiguous", ("stribeck_friction",), classes=twins, separation=1.0)
    assert ambiguous.right
    assert ambiguous.exact
    assert not one(effects=("stribeck_friction",)).right
    found = by_name([ambiguous, one(), one(effects=("stribeck_friction",)), one("adequate", (), first="x")])
    assert found["accepted and wrong", "one or two hidden"] == (1, 4)
    assert found["hidden effect found as first", "λ = 10, all cos < 0.85"] == (1, 4)
    assert found["reports the class", "d < 2.33"] == (1, 1)
    assert found["class of one", "d >= 2.33"] == (1, 1)


def test_two_hidden_effects_are_exact_only_if_both_and_no_others_are_named() -> None:
    def two(*effects: str) -> Outcome:
        return Outcome(TWO, verdict="missing_effect", effects=effects)

    assert two("piston_leakage", "coulomb_friction").exact
    assert two("piston_leakage").right
    assert not two("piston_leakage").exact
    assert not two("piston_leakage", "coulomb_friction", "spring_load").right
    assert not two("piston_leakage", "spring_load").exact


def test_pairs_in_which_one_effect_masks_the_other_are_counted_separately() -> None:
    both = ("coulomb_friction", "piston_leakage")
    missed = Outcome(TWO, verdict="missing_effect", effects=both[:1], beside=(12.0, 3.0))
    found = Outcome(TWO, verdict="missing_effect", effects=both, beside=(12.0, 11.0))
    unknown = Outcome(TWO, verdict="missing_effect", effects=both[:1])
    rows = by_name([missed, found, unknown])
    assert rows["two hidden effects exactly", "λ >= 10 each"] == (1, 3)
    assert rows["two hidden effects exactly", "λ >= 10 each, also beside the other"] == (1, 2)


def test_removed_truths_interval_coverage_and_untested_trials_are_counted() -> None:
    inside = Interval("coulomb_friction", "force", 100.0, 90.0, 110.0)
    outside = Interval("coulomb_friction", "force", 100.0, 101.0, 110.0)
    same = Scenario("one", ONE.hidden, "same")
    outcomes = [
        Outcome(REMOVED, verdict="outside_library", rival_cosine=0.3),
        Outcome(REMOVED, verdict="missing_effect", effects=("spring_load",), rival_cosine=0.95),
        Outcome(same, verdict="missing_effect", effects=("coulomb_friction",), intervals=(inside, outside)),
        Outcome(ONE, untested="λ 10 cannot be reached"),
    ]
    found = by_name(outcomes)
    name = "outside_library, truth removed from it"
    assert found[name, "best rival's cos < 0.85"] == (1, 1)
    assert found[name, "all"] == (1, 2)
    assert found["95 % interval covers the truth", "the library’s own shape"] == (1, 2)
    untested = figures(outcomes).document()["untested"]
    assert untested == [{"scenario": ONE.name, "why": "λ 10 cannot be reached"}]


def test_the_confusion_table_counts_the_effect_found_first() -> None:
    outcomes = [one(), one(), one(effects=("spring_load",)), one("adequate", (), first="spring_load")]
    assert confusion(outcomes) == {"coulomb_friction": {"coulomb_friction": 2, "spring_load": 1, "none": 1}}


def test_markdown_and_console_tables_show_the_same_figures() -> None:
    from io import StringIO

    from rich.console import Console

    outcomes = [one(), one(effects=("spring_load",)), Outcome(NOTHING, verdict="adequate")]
    text = markdown(figures(outcomes))
    assert "| coulomb_friction | 1 of 2 | spring_load 1 |" in text
    assert "| 50.0 % | 9.5 % to 90.5 % | 1 of 2 | at least 97.0 %: missed |" in text
    console = Console(file=StringIO(), width=200)
    console.print(rates_table(figures(outcomes)))
    console.print(confusion_table(figures(outcomes)))
    shown = console.file.getvalue()
    assert "1 of 2" in shown
    assert "spring_load 1" in shown
    json.dumps(figures(outcomes).document(), allow_nan=False)


def test_an_outcome_survives_json() -> None:
    outcome = one(
        classes=(("a", "b"),),
        intervals=(Interval("e", "p", 1.0, 0.5, 2.0),),
        sizes=(9.9,),
        amplitudes=(50.0,),
    )
    assert TrialOutcome.read(json.loads(json.dumps(outcome.document())), Scenario.read) == outcome


def test_an_outcome_of_a_version_without_exponents_is_read() -> None:
    corrected = one(exponents=(Interval("e", "exponent of velocity", 1.5, 1.4, 1.7),))
    document = json.loads(json.dumps(corrected.document()))
    assert TrialOutcome.read(document, Scenario.read) == corrected
    del document["exponents"]
    assert TrialOutcome.read(document, Scenario.read) == one()


def test_claimed_exponents_are_counted_where_a_law_was_corrected() -> None:
    right, wrong = (Interval("e", "exponent of velocity", truth, 1.4, 1.7) for truth in (1.5, 2.0))
    outcomes = [one(), one(exponents=(right,)), one(exponents=(right, wrong))]
    (rate,) = [rate for rate in shape_rates(outcomes) if rate.name == "law corrected"]
    assert (rate.count, rate.trials) == (1, 2)
    assert not [rate for rate in shape_rates([one()]) if rate.name == "law corrected"]


def counted(outcomes: list[Outcome], name: str, of: str = "all sizes") -> tuple[int, int]:
    (rate,) = [rate for rate in shape_rates(outcomes) if (rate.name, rate.of) == (name, of)]
    return rate.count, rate.trials


def test_an_ambiguous_class_is_right_where_the_rival_is_inseparable() -> None:
    """d is below 2.33 or within the shape tolerance: no data of these sensors distinguish the two."""
    name = "place and driver, or the class where none can tell"
    classes = (("spring_load", "coulomb_friction"),)
    undecided = [
        replace(
            one("ambiguous", ("spring_load",), classes=classes, separation=apart),
            scenario=Scenario("one", (Wanted("coulomb_friction", size),)),
        )
        for size, apart in ((30.0, 2.0), (30.0, 3.5), (300.0, 20.0), (300.0, 40.0))
    ]
    sure = one(claims=(Claim("coulomb_friction", place=True, driver=True, law=False),))
    assert counted([*undecided, sure], name) == (3, 5)
    assert counted([*undecided, sure], "place and driver named") == (1, 5)
    apart = one("ambiguous", ("spring_load",), separation=1.0)
    assert counted([apart], name) == (0, 1)  # the truth is not in its class


def test_effects_beyond_their_usual_range_are_counted_separately() -> None:
    usual, larger = (one(amplitudes=(force,)) for force in (500.0, 5000.0))
    assert counted([usual, larger], "law or its class named") == (1, 1)
    assert counted([usual, larger], "beyond its usual range", "named or in the class") == (1, 1)


def test_pairs_of_effects_that_are_both_detectable_have_their_own_rate() -> None:
    both = {"effects": ("coulomb_friction", "piston_leakage"), "verdict": "missing_effect"}
    seen, hidden = (Outcome(TWO, beside=beside, **both) for beside in ((30.0, 12.0), (30.0, 2.0)))
    within = Outcome(TWO, beside=(30.0, 12.0), beyond_laws=(30.0, 7.0), **both)
    name = "a strong and a weak effect: both named"
    assert counted([seen, hidden, within], name, "all") == (3, 3)
    of = "λ >= 10 each, also beside the other and beyond its tolerance"
    assert counted([seen, hidden, within], name, of) == (1, 1)
