"""Of several effects that leave something, one may be certain: as it would be by itself."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from linear_problem import PLAIN, compared, made_design, made_effect
from rigctl.analysis.linear.size_scatter import SizeScatter
from rigctl.analysis.search import certainty
from rigctl.analysis.search.certainty import FoundSet, certain_levels
from rigctl.analysis.search.reasons import NotPredicted
from rigctl.analysis.search.remainder import Remainder
from rigctl.analysis.search.search import Search
from rigctl.answers.findings.reasons import reason_text

REMAINDER = Remainder(0.01, 20.0, 1e-6, "", "", "")
NONE, LOCATION = (False, False, False), (True, False, False)
#: the shares that the two leave alone
LEFT = {"alpha": 0.02, "beta": 0.98}


@pytest.fixture
def pair(monkeypatch: pytest.MonkeyPatch) -> Callable[..., FoundSet]:
    """A large alpha and a small beta as the answer, with the share that each of them leaves alone."""
    design = made_design(PLAIN, np.eye(len(PLAIN)))
    readings = design.readings({"alpha.size": 300.0, "beta.size": 30.0}, design.typical_noise())
    before = compared(design, readings)
    search = Search(before, before.whole)
    candidates = {one.name: one for one in before.linearisation.candidates}

    def made(left: Mapping[str, float], remaining: Remainder | None = REMAINDER, **more: Any) -> FoundSet:
        alpha, beta = candidates["alpha"], candidates["beta"]
        first, second = (search.refitted([one], search.null) for one in (alpha, beta))
        assert first is not None and second is not None
        both = search.refitted([alpha, beta], first)
        assert both is not None
        monkeypatch.setattr(Search, "left", lambda _, trial: left.get("+".join(trial.effects), 0.01))
        monkeypatch.setattr(certainty, "find_rivals", lambda *_: [])
        monkeypatch.setattr(certainty, "classes_of", lambda *_: more.get("alone", (("alpha",),)))
        monkeypatch.setattr(certainty, "remainder", lambda *_: REMAINDER)
        monkeypatch.setattr(certainty, "cross_validations", lambda *_: {})
        return FoundSet(search, both, more.get("classes", (("alpha",), ("beta",))), {}, remaining)

    return made


def levels(answer: FoundSet) -> list[tuple[bool, bool, bool]]:
    return [(one.place_sure, one.driver_sure, one.law_sure) for one in certain_levels(answer, (), ())]


def test_an_effect_that_alone_leaves_no_more_than_its_law_may_stays_certain(
    pair: Callable[..., FoundSet],
) -> None:
    answer = pair(LEFT)
    assert answer.best.effects == ("alpha", "beta")
    found = certain_levels(answer, (), ())
    assert [one.place_sure for one in found] == [True, False]
    assert not any(one.law_sure for one in found)
    assert answer.certain_alone(found) == ("alpha",)
    assert answer.left_alone(found) == {"alpha": pytest.approx(0.02)}
    (reason,) = answer.against(answer.certain_alone(found))
    assert reason_text(reason).startswith(
        "beta may only resemble what is missing besides alpha: together they leave "
    )


def test_effects_that_only_together_explain_enough_are_not_certain(pair: Callable[..., FoundSet]) -> None:
    """As two laws that imitate the heat of a stirrer, which is in no library."""
    answer = pair({"alpha": 0.14, "beta": 0.6})
    assert levels(answer) == [NONE, NONE]
    assert answer.left_alone(certain_levels(answer, (), ())) == {}
    (reason,) = answer.against()
    assert "together they may imitate" in reason_text(reason)


def test_effects_at_other_locations_beside_the_second_one_or_alone_leave_nothing_certain(
    pair: Callable[..., FoundSet], monkeypatch: pytest.MonkeyPatch
) -> None:
    elsewhere = replace(made_effect("gamma"), terms=(("elsewhere", lambda m, p: p.size),))
    by_name = {"gamma": elsewhere}
    monkeypatch.setattr(Search, "effect", lambda _, name: by_name.get(name, made_effect(name)))
    assert levels(pair(LEFT))[0] == LOCATION
    assert levels(pair(LEFT, classes=(("alpha", "gamma"), ("beta",))))[0] == NONE
    assert levels(pair(LEFT, alone=(("alpha", "gamma"),)))[0] == NONE


def test_neither_the_worse_of_two_nor_a_law_nor_an_effect_in_a_table_is_certain(
    pair: Callable[..., FoundSet], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not even if alone it leaves nothing, which contradicts what the pair leaves."""
    answer = pair({"alpha": 0.02, "beta": 0.02})
    monkeypatch.setattr(certainty, "remainder", lambda *_: None)
    assert levels(answer) == [(True, True, False), NONE]
    answer.search.tolerance = 0.0
    assert levels(answer) == [NONE, NONE]


def test_what_the_pair_shows_of_a_member_counts(pair: Callable[..., FoundSet]) -> None:
    """Its size follows the operating point beside the second effect."""
    follows = cast("SizeScatter", SimpleNamespace(effect="alpha", follows=True))
    answer = pair(LEFT)
    assert certain_levels(answer, (), (follows,))[0].driver_sure is False
    below = replace(REMAINDER, below_noise=True)
    assert levels(pair(LEFT, remaining=below)) == [NONE, NONE]


def test_an_effect_that_alone_fails_cross_validation_is_not_certain(
    pair: Callable[..., FoundSet], monkeypatch: pytest.MonkeyPatch
) -> None:
    answer = pair(LEFT)
    failed = [NotPredicted(("alpha",))]
    monkeypatch.setattr(certainty, "reasons_against", lambda *_, **__: failed)
    assert levels(answer) == [NONE, NONE]


def test_a_complete_pair_is_judged_as_a_pair(pair: Callable[..., FoundSet]) -> None:
    """What a member leaves alone is explained by the other."""
    alone = pair(LEFT, remaining=None)
    assert levels(alone) == [(True, True, True)] * 2
    assert alone.certain_alone(certain_levels(alone, (), ())) == ()
    answer = pair({"alpha": 0.5, "beta": 0.9}, remaining=None)
    assert all(one.place_sure for one in certain_levels(answer, (), ()))
    assert answer.left_alone(certain_levels(answer, (), ())) == {}


def test_a_wrong_prediction_is_refitted_with_and_without_the_member(
    pair: Callable[..., FoundSet], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Beside the others as they were fitted without it; a refit that fails says nothing."""
    answer = pair(LEFT)
    search, best = answer.search, answer.best
    alpha, beta = best.candidates
    alone = search.known([alpha])
    assert alone is not None
    left = {id(search.null.fit): 90.0, id(alone.fit): 50.0, id(best.fit): 20.0}
    asked: list[list[int]] = []

    def left_by_refit(fit: Any, outside: list[int]) -> float | None:
        asked.append(outside)
        return left.get(id(fit))

    monkeypatch.setattr(certainty, "left_by_refit", left_by_refit)
    monkeypatch.setattr(certainty, "held_out_gain", lambda *given: given[-1] and given[-1]((1, 3)))
    sure = {"sure": True}
    monkeypatch.setattr(Search, "sure", lambda *_: sure["sure"])

    def squares(of: Any, member: Any) -> Any:
        return certainty._cross_validation(search, of, member)

    assert squares(best, beta) == (50.0, 20.0)
    assert asked == [[best.fit.fitted[1], best.fit.fitted[3]]] * 2
    assert squares(alone, alpha) == (90.0, 50.0)
    for lost in (alone, best):
        kept = left.pop(id(lost.fit))
        assert squares(best, beta) is None
        left[id(lost.fit)] = kept
    sure["sure"] = False  # it leaves too much for its refits to be the right ones
    assert squares(best, beta) is None
    sure["sure"] = True
    search.trials.clear()
    assert squares(best, beta) is None
    one = SimpleNamespace(linearisation=SimpleNamespace(records=(None,)))
    monkeypatch.setattr(Search, "at", lambda *_: one)
    monkeypatch.setattr(certainty, "held_out_gain", lambda *_: pytest.fail("one record has no other"))
    assert squares(best, beta) is None
