"""Search, separability and verdicts on a linear problem, where enumeration gives the best set."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from linear_problem import (
    FAMILY,
    NAMES,
    NUISANCES,
    PLAIN,
    Design,
    compared,
    made_design,
    made_effect,
    made_parameter,
    random_gram,
)
from rigctl.analysis.comparison_result import Comparison
from rigctl.analysis.decision_levels import LEAST_DIFFERENCE, LEAST_SEPARATION
from rigctl.analysis.diagnosis import diagnose, diagnose_comparison
from rigctl.analysis.diagnosis_result import Diagnosis, Verdict
from rigctl.analysis.improve import Improvement, ImprovementEnd, improve
from rigctl.analysis.linear.pair_gains import pair_gains
from rigctl.analysis.search.search import Search
from rigctl.answers.findings.evidence import sentence
from rigctl.errors import RigctlError
from rigctl.model.load import load_model

Floats = NDArray[np.float64]


def alike(cos: float) -> Floats:
    """alpha and beta at this cosine, the others orthogonal to all."""
    gram = np.eye(len(PLAIN))
    gram[0, 1] = gram[1, 0] = cos
    return gram


def readings_of(design: Design, sizes: Mapping[str, float], noise: Floats | None = None) -> Floats:
    """Readings with effects of these sizes, in sigmas; noise of average size unless given."""
    known = {name if "." in name else f"{name}.size": size for name, size in sizes.items()}
    return design.readings(known, design.typical_noise() if noise is None else noise)


def diagnosed(design: Design, sizes: Mapping[str, float], noise: Floats | None = None) -> Diagnosis:
    return diagnose_comparison(compared(design, readings_of(design, sizes, noise)))


def best_of_all(design: Design, y: Floats) -> tuple[str, ...]:
    """The set with the lowest mBIC among none, all single effects and all pairs, by dense least squares."""
    names = [effect.name for effect in design.effects]
    sets = [(), *((name,) for name in names), *combinations(names, 2)]
    return min(sets, key=lambda chosen: design.mbic(y, chosen))


@pytest.mark.parametrize("seed", range(5))
def test_the_search_finds_the_same_best_set_as_enumeration(seed: int) -> None:
    """One or two effects of eight to fourteen sigmas, in noise as it is drawn."""
    rng = np.random.default_rng(seed)
    design = made_design(PLAIN, random_gram(rng, 6, 14), correlation=0.3, seed=seed)
    chosen = rng.choice(NAMES, 1 + seed % 2, replace=False)
    sizes = {name: float(rng.choice([-1, 1]) * rng.uniform(8.0, 14.0)) for name in chosen}
    y = readings_of(design, sizes, design.drawn_noise(rng))
    before = compared(design, y)
    search = Search(before, before.whole)
    assert sorted(search.best().effects) == sorted(best_of_all(design, y))
    tried = [search.null, *search.trials.values()]
    least = min(trial.chi2 for trial in tried)
    for trial in tried:  # sets far behind the best are fitted less precisely
        exact = design.chi2(y, trial.effects)
        assert -0.02 < trial.chi2 - exact < 0.02 + 0.02 * (exact - least)
        price = design.mbic(y, trial.effects) - exact
        assert search.mbic(trial) - trial.chi2 == pytest.approx(price, rel=1e-9, abs=1e-9)


def test_the_gains_of_all_pairs_agree_with_dense_algebra() -> None:
    rng = np.random.default_rng(1)
    design = made_design(PLAIN, random_gram(rng, 6, 14), correlation=0.3)
    y = readings_of(design, {"beta": 7.0, "zeta": 9.0}, design.drawn_noise(rng))
    before = compared(design, y)
    found = {
        tuple(sorted(before.linearisation.candidates[k].name for k in pair.candidates)): pair.gain
        for pair in pair_gains(before.projected)
    }
    assert len(found) == 15
    for names, gain in found.items():
        assert gain == pytest.approx(design.chi2(y) - design.chi2(y, names), rel=1e-8)


def stand_in(more: float) -> Design:
    """The sum of beta and gamma, eight sigmas each, is alpha but for `more` sigmas."""
    size = 8.0 * math.sqrt(2.0)
    cos = math.sqrt(0.5 * (1.0 - (more / size) ** 2))
    gram = np.eye(len(PLAIN))
    gram[0, 1:3] = gram[1:3, 0] = cos
    return made_design(PLAIN, gram)


TWO = {"beta": 8.0, "gamma": 8.0}


def test_one_adequate_effect_does_not_replace_two_with_a_lower_mbic() -> None:
    """alpha leaves an undetectable 36 in χ² of 189, and is 27 worse in mBIC; it used to be named alone."""
    design = stand_in(6.0)
    y = readings_of(design, TWO)
    alone = compared(replace(design, effects=design.effects[:1]), y)
    after = Search(alone, alone.whole)
    assert after.at(after.best()).adequacy.agrees
    assert design.mbic(y, ["alpha"]) - design.mbic(y, ["beta", "gamma"]) > 20.0
    found = diagnosed(design, TWO)
    assert found.verdict is Verdict.MISSING_EFFECT
    assert sorted(found.effects) == ["beta", "gamma"]


def test_one_effect_and_two_of_similar_odds_are_ambiguous() -> None:
    design = stand_in(4.0)
    y = readings_of(design, TWO)
    assert 0.0 < design.mbic(y, ["alpha"]) - design.mbic(y, ["beta", "gamma"]) < LEAST_DIFFERENCE
    found = diagnosed(design, TWO)
    assert found.verdict is Verdict.AMBIGUOUS
    assert found.classes == (("alpha", "beta", "gamma"),)
    assert found.statement.count("together would look like alpha") == 1
    assert any("together would look like alpha" in sentence(one) for one in found.evidence)


def test_an_effect_with_a_small_remainder_is_not_distinguished_from_two() -> None:
    """Found by a search over seeds: a test rejects its remainder, 1 % of the misfit.

    So small a remainder may be scatter in the size of an effect without a driver.
    """
    rng = np.random.default_rng(1055)
    effects = [made_effect(f"effect_{k}") for k in range(8)]
    design = made_design(effects, random_gram(rng, 8, 6), correlation=0.3, seed=1055)
    chosen = sorted(rng.choice([effect.name for effect in effects], 2, replace=False))
    sizes = {name: float(rng.choice([-1, 1]) * rng.uniform(8.0, 20.0)) for name in chosen}
    noise = design.drawn_noise(rng)
    y = readings_of(design, sizes, noise)
    assert 0.0 < design.mbic(y, ["effect_0"]) - design.mbic(y, chosen) < LEAST_DIFFERENCE
    found = diagnosed(design, sizes, noise)
    assert found.remainder is None
    assert found.verdict is Verdict.AMBIGUOUS
    assert found.classes == (("effect_0", *chosen),)


def test_two_required_effects_are_both_named() -> None:
    found = diagnosed(made_design(PLAIN, alike(0.3)), {"alpha": 9.0, "beta": -8.0})
    assert found.verdict is Verdict.MISSING_EFFECT
    assert sorted(found.effects) == ["alpha", "beta"]
    assert found.classes == (("alpha",), ("beta",))


@pytest.mark.parametrize("cos", [0.6, 0.9, 0.97])
def test_two_effects_share_a_class_below_the_predicted_separation(cos: float) -> None:
    """d = λ·√((1 − cos)/2) = 2.33, from both sides."""
    design = made_design(PLAIN, alike(cos))
    limit = LEAST_SEPARATION / math.sqrt(0.5 * (1.0 - cos))
    found = diagnosed(design, {"alpha": 0.97 * limit})
    assert found.verdict is Verdict.AMBIGUOUS
    assert found.classes == (("alpha", "beta"),)
    assert found.indistinguishable == (("alpha", "beta"),)
    found = diagnosed(design, {"alpha": 1.03 * limit})
    assert found.verdict is Verdict.MISSING_EFFECT
    assert found.classes == (("alpha",),)


@pytest.mark.parametrize(("cos", "told"), [(0.996, False), (0.994, True)])
def test_the_shape_of_a_large_effect_may_deviate_by_a_tenth(cos: float, told: bool) -> None:
    """1 − cos² is the share of χ² by which the two differ: 0.8 and 1.2 %, at d of 3.6 and 4.4."""
    found = diagnosed(made_design(PLAIN, alike(cos)), {"alpha": 80.0})
    assert found.classes == ((("alpha",),) if told else (("alpha", "beta"),))


def test_the_probabilities_follow_from_mbic() -> None:
    """Over all sets examined, including the empty one; 36 in χ² is too small for shapes to matter."""
    design = made_design(PLAIN, alike(0.8))
    y = readings_of(design, {"alpha": 6.0})
    found = diagnose_comparison(compared(design, y))
    assert found.best.effects == ("alpha",)
    weights = {name: math.exp(-0.5 * design.mbic(y, [name])) for name in NAMES}
    total = math.exp(-0.5 * design.mbic(y)) + sum(weights.values())
    for one in found.ranking:
        assert one.probability == pytest.approx(weights[one.effect] / total, rel=0.02)


def test_a_model_that_lacks_nothing_is_adequate() -> None:
    rng = np.random.default_rng(11)
    design = made_design(PLAIN, random_gram(rng, 6, 14), correlation=0.3)
    for noise in (design.typical_noise(), design.drawn_noise(rng)):
        found = diagnosed(design, {}, noise)
        assert found.verdict is Verdict.ADEQUATE
        assert found.effects == found.classes == ()
        assert "agrees with the measurements" in found.statement


def strange(design: Design, size: float) -> Floats:
    """Typical noise with a misfit of `size` sigmas that no parameter explains."""
    return np.asarray(
        design.typical_noise(0) * math.sqrt(1.0 + size**2 / (len(design.root) - len(NUISANCES)))
    )


def test_a_misfit_that_no_effect_explains_is_outside_the_library() -> None:
    found = diagnosed(made_design(PLAIN, np.eye(6)), {}, strange(made_design(PLAIN, np.eye(6)), 20.0))
    assert found.verdict is Verdict.OUTSIDE_LIBRARY
    assert found.effects == ()
    assert found.statement == "Something is missing that no effect of the library explains"


@pytest.mark.parametrize(
    ("size", "verdict"), [(15.0, Verdict.MISSING_EFFECT), (40.0, Verdict.OUTSIDE_LIBRARY)]
)
def test_the_remainder_is_reported_and_decides_above_three_percent(size: float, verdict: Verdict) -> None:
    """The excess over the spread of χ² is 2 and 13 % of the whole misfit, less the small part absorbed by
    sizes of alpha that differ between records."""
    design = made_design(PLAIN, np.eye(6))
    found = diagnosed(design, {"alpha": 100.0}, strange(design, size))
    dof = len(design.root) - len(NUISANCES) - 1
    excess = size**2 + 1.0 - LEAST_SEPARATION * math.sqrt(2.0 * dof)
    assert found.verdict is verdict
    assert found.remainder is not None
    assert found.remainder.share == pytest.approx(excess / (1e4 + excess), rel=0.1)
    assert found.remainder.share < excess / (1e4 + excess)
    assert found.remainder.size == pytest.approx(math.sqrt(excess), rel=0.05)
    assert ("That is not all" in found.statement) is (verdict is Verdict.MISSING_EFFECT)
    assert ("The nearest in the library" in found.statement) is (verdict is Verdict.OUTSIDE_LIBRARY)


def test_two_effects_that_leave_something_are_named_without_certainty() -> None:
    """The remainder of 15 sigmas is 1 % of the misfit, which a single effect may leave."""
    design = made_design(PLAIN, np.eye(6))
    diagnosis = diagnosed(design, {"alpha": 100.0, "beta": 90.0}, strange(design, 15.0))
    assert diagnosis.remainder is not None
    assert diagnosis.remainder.share < 0.02
    assert diagnosis.verdict is Verdict.AMBIGUOUS
    assert diagnosis.classes == (("alpha",), ("beta",))
    assert not any(one.place_sure or one.driver_sure or one.law_sure for one in diagnosis.levels)
    assert "of the misfit is left" in diagnosis.statement


def test_an_effect_absorbed_by_fitted_parameters_is_untestable() -> None:
    design = made_design([*PLAIN[:2], made_effect("gamma", needs="another load")], np.eye(3))
    hidden = {**design.columns, "gamma.size": 2.0 * design.columns["gain"] - design.columns["slope"]}
    found = diagnosed(replace(design, columns=hidden), {"alpha": 9.0, "gamma": 50.0})
    assert found.effects == ("alpha",)
    assert found.untestable == (("gamma", "another load"),)


@pytest.mark.parametrize(("rate", "verdict"), [(0.5, Verdict.AMBIGUOUS), (12.0, Verdict.MISSING_EFFECT)])
def test_a_law_close_to_a_nested_one_is_not_distinguished_from_it(rate: float, verdict: Verdict) -> None:
    """broad is narrow where its rate is 0; the data do not have narrow's own shape otherwise."""
    broad = made_effect(
        "broad",
        parameters=(made_parameter("size"), made_parameter("rate")),
        becomes=(("rate", 0.0, "narrow"),),
    )
    gram = np.eye(3)
    gram[0, 2] = gram[2, 0] = 0.97
    design = made_design([broad, made_effect("narrow")], gram)
    found = diagnosed(design, {"broad.size": 30.0, "broad.rate": rate})
    assert found.verdict is verdict
    assert found.effects == ("broad",)
    assert found.classes == ((("broad", "narrow"),) if rate < 1.0 else (("broad",),))


@settings(max_examples=2)
@given(st.permutations(range(6)), st.integers(0, 2**31))
def test_the_verdict_does_not_depend_on_the_order_of_the_effects(order: list[int], seed: int) -> None:
    rng = np.random.default_rng(seed)
    design = made_design(PLAIN, random_gram(rng, 6, 14))
    sizes = {"alpha": 6.0, "beta": 9.0}
    noise = design.drawn_noise(rng)
    one = diagnosed(design, sizes, noise)
    other = diagnosed(replace(design, effects=tuple(design.effects[k] for k in order)), sizes, noise)
    assert one.verdict is other.verdict
    assert sorted(one.effects) == sorted(other.effects)
    assert sorted(map(sorted, one.classes)) == sorted(map(sorted, other.classes))


def improved(
    design: Design, sizes: Mapping[str, float], folder: Path, monkeypatch: pytest.MonkeyPatch, most: int = 4
) -> Improvement:
    """`improve` on a model file whose family and effects are registered as from an installed package."""
    monkeypatch.setattr("rigctl.model.load.find_family", lambda *_: FAMILY)
    monkeypatch.setattr("rigctl.effects.registry.installed_effects", lambda: design.effects)
    path = folder / "m.yaml"
    lines = [f"  {name}: {{value: 10, fit: true}}" for name in NUISANCES]
    path.write_text("\n".join(["model: linear", "parameters:", *lines, ""]), encoding="utf-8")
    before = compared(design, readings_of(design, sizes))
    return improve(Comparison(("r",), (), (before,), ()), path, most=most)


def test_improve_adds_the_largest_gain_first_and_stops_when_adequate(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    design = made_design(PLAIN, np.eye(6))
    found = improved(design, {"beta": 9.0, "delta": 12.0}, tmp_path, monkeypatch)
    assert [step.effects for step in found.steps] == [("delta",), ("beta",)]
    assert found.ended is ImprovementEnd.ADEQUATE
    y = readings_of(design, {"beta": 9.0, "delta": 12.0})
    fall = [
        design.mbic(y, ["delta"]) - design.mbic(y),
        design.mbic(y, ["beta", "delta"]) - design.mbic(y, ["delta"]),
    ]
    assert [step.delta_bic for step in found.steps] == pytest.approx(fall, abs=0.05)
    saved = load_model(tmp_path / "m.yaml")
    assert {name: own["size"].si for name, own in saved.effects.items()} == pytest.approx(
        {"delta": 12.0, "beta": 9.0}, abs=1e-2
    )


def test_a_search_for_no_effect_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A diagnosis tried single effects all the same, and `improve` said that it had added the most."""
    design = made_design(PLAIN, np.eye(6))
    said = "too few effects to search for, got '0'; expected at least 1"
    with pytest.raises(RigctlError, match=said):
        improved(design, {"beta": 9.0}, tmp_path, monkeypatch, most=0)
    with pytest.raises(RigctlError, match=said):
        diagnose_comparison(compared(design, readings_of(design, {"beta": 9.0})), most=0)
    with pytest.raises(RigctlError, match=said):
        diagnose([], load_model(tmp_path / "m.yaml"), most=0)


def test_effects_that_improve_the_fit_only_together_are_added_together(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They nearly cancel: each alone gains 2 in χ², both together 200."""
    found = improved(made_design(PLAIN, alike(0.98)), {"alpha": 71.0, "beta": -71.0}, tmp_path, monkeypatch)
    assert [sorted(step.effects) for step in found.steps] == [["alpha", "beta"]]
    assert "only together" in found.steps[0].addition.reason


def test_improve_adds_no_more_than_the_requested_number_of_effects(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    design = made_design(PLAIN, np.eye(6))
    found = improved(design, {"beta": 9.0, "delta": 12.0}, tmp_path, monkeypatch, most=1)
    assert [step.effects for step in found.steps] == [("delta",)]
    assert found.ended is ImprovementEnd.MAX_EFFECTS
