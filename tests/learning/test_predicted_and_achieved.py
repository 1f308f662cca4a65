"""Predictions and results: margins before and after, and a bench that contradicts every rival."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pytest

from rigctl.analysis.diagnosis_result import Diagnosis, Verdict
from rigctl.learning.predicted_and_achieved import round_outcome
from rigctl.learning.result import PredictedRound, Round, RoundOutcome


def predicted(**weights: float) -> PredictedRound:
    """Between leak and drift; the data so far prefer the leak by 3."""
    pairs = [("leak", "drift", 3.0, 20.0), ("drift", "leak", -3.0, 16.0)]
    outlooks = tuple(
        {"truth": truth, "rival": rival, "margin": margin, "separation": d}
        for truth, rival, margin, d in pairs
    )
    return PredictedRound(
        weights or {"leak": 0.8, "drift": 0.2}, 19.0, 0.9, outlooks, 600.0, ("oil 60 degC",)
    )


def diagnosis(
    verdict: Verdict, classes: list[list[str]], *, sensors: tuple[str, ...] = (), **scores: float
) -> Diagnosis:
    ranking = [SimpleNamespace(effect=name, delta_bic=score) for name, score in scores.items()]
    effects = tuple(names[0] for names in classes)
    made: Any = SimpleNamespace(
        verdict=verdict,
        classes=tuple(map(tuple, classes)),
        effects=effects,
        ranking=ranking,
        instead_of_sensors=sensors,
    )
    return cast("Diagnosis", made)


def said(found: Diagnosis, out: RoundOutcome) -> str:
    return Round(2, "", effects=found.effects, predicted=predicted(), achieved=out).outcome


def test_the_gain_is_the_change_of_the_margin() -> None:
    found = diagnosis(Verdict.MISSING_EFFECT, [["leak"]], leak=-60.0, drift=-35.0)
    out = round_outcome(predicted(), found)
    assert out.winner == "leak"
    assert out.distinguished
    assert out.kept
    assert out.gains == {"drift": pytest.approx(25.0 - 3.0)}
    assert out.expected == {"drift": 20.0}
    assert said(found, out) == "leak is distinguished: its margin over drift increased by 22 (expected: 20)"


def test_the_less_probable_rival_may_win() -> None:
    out = round_outcome(predicted(), diagnosis(Verdict.MISSING_EFFECT, [["drift"]], leak=-30.0, drift=-45.0))
    assert out.winner == "drift"
    assert out.gains == {"leak": pytest.approx(15.0 + 3.0)}


def test_rivals_still_in_one_class_are_not_separated() -> None:
    found = diagnosis(Verdict.AMBIGUOUS, [["leak", "drift"]], leak=-40.0, drift=-38.0)
    out = round_outcome(predicted(), found)
    assert out.winner == "leak"
    assert not out.distinguished
    assert out.kept
    assert out.gains["drift"] == pytest.approx(-1.0)


@pytest.mark.parametrize(
    "found",
    [
        diagnosis(Verdict.MISSING_EFFECT, [["spring"]], spring=-80.0, leak=-20.0, drift=-10.0),
        diagnosis(Verdict.OUTSIDE_LIBRARY, [], leak=-20.0, drift=-10.0),
        diagnosis(Verdict.ADEQUATE, []),
    ],
)
def test_a_bench_that_contradicts_every_rival_refutes_the_prediction(found: Diagnosis) -> None:
    out = round_outcome(predicted(), found)
    assert not out.kept
    assert out.winner == ""
    assert "behaved differently from every rival's prediction" in said(found, out)


def test_a_winner_left_in_the_class_but_not_designed_for_is_accepted() -> None:
    """A class may have more members than the design considers."""
    found = diagnosis(Verdict.MISSING_EFFECT, [["spring"]], spring=-80.0, leak=-20.0, drift=-10.0)
    out = round_outcome(predicted(), found, candidates={"leak", "drift", "spring"})
    assert (out.kept, out.winner, out.distinguished) == (True, "spring", True)
    assert (
        said(found, out) == "spring is named now, which the data allowed but the round was not designed for"
    )
    again = diagnosis(Verdict.AMBIGUOUS, [["load", "spring"]], spring=-80.0, load=-81.0)
    assert not round_outcome(predicted(), again, candidates={"leak", "drift", "spring"}).distinguished
    assert not round_outcome(predicted(), found, candidates={"leak", "drift"}).kept


def test_no_missing_effect_may_be_one_of_the_rivals() -> None:
    out = round_outcome(predicted(leak=0.6, none=0.4), diagnosis(Verdict.ADEQUATE, [], leak=4.0))
    assert out.winner == "none"
    assert out.kept
    assert out.distinguished


def test_a_sensor_that_still_competes_with_an_effect_is_not_distinguished() -> None:
    found = diagnosis(Verdict.ADEQUATE, [], sensors=("leak",), leak=4.0)
    out = round_outcome(predicted(leak=0.6, none=0.4), found)
    assert (out.winner, out.kept, out.distinguished) == ("none", True, False)
