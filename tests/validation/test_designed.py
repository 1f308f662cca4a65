"""The tier ``design``: its trials, and the counts of predicted separations and of wrong names."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import pytest

from rigctl_validation.designed.picture import calibration_svg
from rigctl_validation.designed.rates import CalibrationBin, calibration_bins, design_rates
from rigctl_validation.designed.trial import TWINS, DesignTrial, design_trials
from rigctl_validation.designed.work import DesignOutcome
from rigctl_validation.hidden_library import find_hidden
from rigctl_validation.outcome import LearningOutcome, TrialOutcome
from rigctl_validation.store import every_outcome


def outcome(*truth: str, rounds: int = 2, **learnt: Any) -> DesignOutcome:
    found = LearningOutcome(**{"left": (("leak", "drift"),), "probability": 0.95, **learnt})
    return TrialOutcome(
        DesignTrial(truth or ("leak",), 20.0, rounds=rounds), verdict="ambiguous", learnt=found
    )


def rate(name: str, of: str, *made: DesignOutcome) -> tuple[int, int]:
    (found,) = [one for one in design_rates(made) if (one.name, one.of) == (name, of)]
    return found.count, found.trials


def test_design_trials_are_distinct_and_hide_effects_of_the_bench() -> None:
    trials = design_trials()
    assert len({one.name for one in trials}) == len(trials) > 100
    for name in TWINS:
        assert find_hidden(name).amounts(1.0)
    assert {one.rounds for one in trials} == {2, 6}
    assert {one.scenario.kind for one in trials} == {"one", "two"}


def test_a_trial_and_its_outcome_survive_json() -> None:
    made = outcome("leak", "spring", added=("leak",), gains={"drift": 3.0}, winner="leak", told=True)
    text = json.dumps(made.document())
    assert TrialOutcome.read(json.loads(text), DesignTrial.read) == made


@pytest.mark.parametrize(
    ("added", "alone", "wrong"),
    [(("leak",), 1, 0), (("drift",), 0, 1), ((), 0, 0), (("leak", "drift"), 0, 1)],
)
def test_a_designed_set_is_right_only_if_the_truth_alone_is_named(
    added: tuple[str, ...], alone: int, wrong: int
) -> None:
    made = outcome(added=added)
    assert rate("one designed set", "the truth alone is named", made) == (alone, 1)
    assert rate("one designed set", "another one is named", made) == (wrong, 1)


def at_random(**learnt: Any) -> DesignOutcome:
    """An outcome with two random records instead of a designed set."""
    return replace(outcome(**learnt), scenario=DesignTrial(("leak",), 20.0, taken=2, draw=1))


def test_pairs_are_counted_by_their_predicted_probability() -> None:
    kept = outcome(chances={"drift": 0.85, "spring": 1.0}, apart=("drift", "spring"))
    broken = at_random(chances={"drift": 0.95, "spring": 0.1}, apart=("spring",))
    never = outcome(probability=None)
    low, high = calibration_bins((kept, broken, never))
    assert (low.low, low.mean, low.achieved, low.pairs) == (0.0, 0.1, 1, 1)
    assert (high.low, high.mean) == (0.8, pytest.approx((0.85 + 1.0 + 0.95) / 3.0))
    assert (high.achieved, high.pairs) == (2, 3)
    assert high.rate.met is None  # three pairs are too few for a rate
    many = [kept] * 12 + [broken] * 12
    (high,) = [one for one in calibration_bins(many) if one.high == 1.0]
    assert high.rate.met is False  # 67 % were separated, 93 % predicted
    assert high.rate.at_least == pytest.approx(high.mean - 0.1)
    assert rate("the campaign leaves a class", "records are proposed", kept, broken, never) == (1, 2)


def test_results_of_an_earlier_version_count_as_one_prediction(tmp_path: Path) -> None:
    """Results of an earlier version stay in the file and are plotted with the others."""
    old = outcome(probability=0.93, winner="leak", told=True)
    document = old.document()
    for name in ("chances", "apart", "of_random", "of_first", "sensor", "statement"):
        del document["learnt"][name]
    path = tmp_path / "design.jsonl"
    path.write_text(json.dumps({"scenario": "x", "version": "method 17", "outcome": document}) + "\n")
    read = every_outcome(path, DesignTrial.read)
    assert read == (old,)
    (found,) = calibration_bins(read)
    assert (found.low, found.mean, found.achieved, found.pairs) == (0.8, 0.93, 1, 1)


def test_random_records_and_designed_sets_are_counted_separately() -> None:
    named = at_random(added=("leak",))
    assert rate("one to four records at random", "the truth alone is named", named, at_random()) == (1, 2)
    assert rate("one designed set", "the truth alone is named", outcome(added=("leak",)), named) == (1, 1)
    trials = design_trials()
    assert sum(bool(one.taken) for one in trials[:40]) == 20
    assert {one.taken for one in trials} == {0, 1, 2, 3, 4}


def test_a_class_without_a_design_must_be_reported_as_inseparable() -> None:
    reported = outcome(probability=None, ended="not_separable")
    silent = outcome(probability=None, ended="rounds")
    made = (reported, silent, outcome(), at_random(probability=None))
    assert rate("a class that no record separates", "reported as such", *made) == (1, 2)


def test_a_design_is_compared_with_the_median_random_one() -> None:
    made = [outcome(of_first=d, of_random=10.0) for d in (39.0, 41.0, 400.0)]
    assert rate("D of the first designed record", "4 times a random one's", *made, outcome()) == (2, 3)


def test_the_calibration_plot_has_a_point_for_each_bin() -> None:
    found = [CalibrationBin(0.0, 0.2, 0.1, 1, 20), CalibrationBin(0.8, 1.0, 0.9, 19, 20)]
    svg = calibration_svg(found)
    root = ET.fromstring(svg)
    points = [one for one in root.iter() if one.tag.endswith("circle")]
    assert [float(one.attrib["cx"]) for one in points] == [pytest.approx(96.0), pytest.approx(352.0)]
    assert float(points[0].attrib["cy"]) > float(points[1].attrib["cy"])
    assert "19 of 20" in svg


def test_learning_is_right_if_it_ends_with_the_truth_or_an_inseparable_class_of_it() -> None:
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
        learnt=LearningOutcome(ended="not_separable"),
    )
    assert rate(*name, left) == (1, 1)
