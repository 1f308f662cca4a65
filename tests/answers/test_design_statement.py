"""How the answer of a design names its rivals."""

from __future__ import annotations

from dataclasses import replace

import pytest

from rigctl.answers.design.statement import statement
from rigctl.design.result import DesignResult, DesignRival, Explanation, PredictedPower, ProposedRecord


def rival(name: str, effects: tuple[str, ...], weight: float) -> DesignRival:
    return DesignRival(name, effects, weight, {}, 100.0, 1.0)


def outlook(truth: str, other: str) -> PredictedPower:
    return PredictedPower(
        truth, other, margin=0.0, threshold=9.2, separation=30.0, spread=5.0, before=0.1, after=0.9
    )


def test_members_of_one_set_are_a_single_explanation() -> None:
    rivals = (
        rival("leak", ("leak", "drift"), 0.4),
        rival("drift", ("leak", "drift"), 0.4),
        rival("friction", ("friction", "drift"), 0.2),
    )
    pairs = [("leak", "friction"), ("drift", "friction"), ("friction", "leak"), ("friction", "drift")]
    found = DesignResult(
        runs=("run",),
        model="model",
        aim="discrimination",
        rivals=rivals,
        outlooks=tuple(outlook(*pair) for pair in pairs),
        records=(),
        separation=30.0,
        before=0.1,
        after=0.9,
        duration=10.0,
    )
    leaks = found.explanations["leak"]
    assert leaks.effects == ("leak", "drift")
    assert leaks.weight == pytest.approx(0.8)
    assert found.explanations["friction"] == Explanation(("friction",), 0.2)
    assert "distinguishes leak with drift and friction" in statement(found)


def test_more_than_two_explanations_are_counted_and_their_pairs_are_not_listed() -> None:
    names = ("leak", "drift", "friction")
    found = DesignResult(
        runs=("run",),
        model="model",
        aim="discrimination",
        rivals=tuple(rival(name, (name,), 1 / 3) for name in names),
        outlooks=tuple(
            replace(outlook(one, other), after=0.1) for one in names for other in names if one != other
        ),
        records=(ProposedRecord({}, (), 1.0, 0.5, 0.1, 0.1, 60.0, 5.0, 100.0),),
        separation=1.0,
        before=0.1,
        after=0.1,
        duration=60.0,
    )
    said = statement(found)
    assert "the right one of these 3 explanations" in said
    assert said.endswith("not reliably distinguished: any two of them")
    assert not any(name in said for name in names)
