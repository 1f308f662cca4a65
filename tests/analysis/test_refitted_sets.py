"""Sets that are fitted again, or put aside, on a linear problem."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from linear_problem import PLAIN, compared, made_design
from rigctl.analysis import refitted_sets
from rigctl.analysis.decision_levels import UNSEEN
from rigctl.analysis.refit import RefittedSet
from rigctl.analysis.rivals import find_rivals
from rigctl.analysis.search import Search


@pytest.fixture
def search() -> Search:
    """alpha and beta nearly the same, and beta is in the data."""
    gram = np.eye(len(PLAIN))
    gram[0, 1] = gram[1, 0] = 0.98
    design = made_design(PLAIN, gram)
    before = compared(design, design.readings({"beta.size": 12.0}, design.typical_noise()))
    return Search(before, before.whole)


def single(search: Search, name: str) -> RefittedSet:
    lin = search.before.linearisation
    found = search.refitted([next(one for one in lin.candidates if one.name == name)], search.none)
    assert found is not None
    return found


def test_a_deeper_minimum_of_a_set_is_what_its_rivals_are_compared_with(
    search: Search, monkeypatch: pytest.MonkeyPatch
) -> None:
    alpha, beta = single(search, "alpha"), single(search, "beta")
    ((before, *_),) = [one for one in search.rivals(beta, beta.candidates[0]) if one[0].effects == ("alpha",)]
    assert before is alpha
    deeper = replace(alpha, chi2=alpha.chi2 - 2.0 * UNSEEN)
    with monkeypatch.context() as patch:
        patch.setattr(refitted_sets, "refit", lambda *_, **__: deeper)
        patch.setattr(Search, "of_few_rows", False)  # a table's fits are not repeated
        assert search.refitted_also_from(alpha.candidates, beta) is deeper
    ((after, *_),) = [one for one in search.rivals(beta, beta.candidates[0]) if one[0].effects == ("alpha",)]
    assert after is deeper


def test_the_model_as_given_has_no_rivals_though_a_set_was_put_aside(search: Search) -> None:
    search.aside = single(search, "alpha")
    assert find_rivals(search, search.none) == []
