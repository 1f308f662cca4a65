"""Scores, p-values and power on a linear problem, where each has a closed form."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.stats import binomtest, chi2, ncx2, norm

from linear_problem import (
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
from rigctl.analysis.agreement.adequacy import adequacy
from rigctl.analysis.comparison_result import ModelComparison
from rigctl.analysis.decision_levels import ALPHA, SEEN_IN_LIBRARY
from rigctl.analysis.linear.linearisation import Linearisation
from rigctl.analysis.linear.nuisance_projection import Projected, project
from rigctl.analysis.linear.power import hidden_at_typical_size
from rigctl.analysis.linear.score_test import null_of_best, screen
from rigctl.analysis.linear.separability import cosine
from rigctl.effects.record_level import RECORD

Floats = NDArray[np.float64]


@pytest.mark.parametrize(("seed", "correlation"), [(0, 0.0), (1, 0.3), (2, 0.8)])
def test_scores_agree_with_dense_linear_algebra(seed: int, correlation: float) -> None:
    rng = np.random.default_rng(seed)
    design = made_design(PLAIN, random_gram(rng, 6, 9), kappa=0.3, correlation=correlation, seed=seed)
    y = design.readings({"beta.size": 6.0, "zeta.size": -5.0}, design.drawn_noise(rng))
    found = compared(design, y)
    for score in found.screening.scores:
        name = f"{score.effect}.size"
        s, raw = design.signature(name), design.columns[name]
        left = design.left_over(y, NUISANCES)
        assert score.z == pytest.approx(abs(s @ left) / np.linalg.norm(s), rel=1e-8)
        assert score.amplitudes == pytest.approx([s @ left / (s @ s)], rel=1e-8)
        whole = raw @ np.linalg.solve(design.noise_alone, raw)
        assert score.kappa == pytest.approx(float(np.sqrt(s @ s / whole)), rel=1e-8)
        by_records = 1.0 - design.white[name] @ design.white[name] / whole
        by_offset = 1.0 - score.kappa**2 - by_records
        assert score.hidden_in == (RECORD if by_records > by_offset else "offset")
    assert {score.effect for score in found.screening.scores} == set(NAMES)


def test_chi_squared_its_degrees_of_freedom_and_the_cosines_agree_with_dense_algebra() -> None:
    rng = np.random.default_rng(3)
    design = made_design(PLAIN, random_gram(rng, 6, 9), correlation=0.5)
    y = design.readings({"beta.size": 6.0}, design.drawn_noise(rng))
    found = compared(design, y)
    misfit = found.adequacy.tests["chi2"]
    assert misfit.statistic == pytest.approx(design.chi2(y), rel=1e-9)
    assert misfit.dof == y.size - len(NUISANCES)
    assert misfit.p_value == pytest.approx(chi2.sf(misfit.statistic, misfit.dof), rel=1e-6)
    for one in range(6):
        for other in range(one):
            s, t = (design.signature(f"{NAMES[k]}.size") for k in (one, other))
            said = abs(s @ t) / np.sqrt((s @ s) * (t @ t))
            assert cosine(found.projected, one, other) == pytest.approx(said, abs=1e-9)


def test_gains_agree_with_dense_algebra_for_two_parameters_and_for_one_sided_effects() -> None:
    effects = [
        made_effect("alpha", parameters=(made_parameter("size"), made_parameter("rate"))),
        made_effect("beta", parameters=(made_parameter("size", low=0.0),)),
        made_effect("gamma", parameters=(made_parameter("size", low=0.0),)),
    ]
    rng = np.random.default_rng(4)
    design = made_design(effects, random_gram(rng, 4, 9), correlation=0.3)
    sizes = {"alpha.size": 4.0, "alpha.rate": -6.0, "beta.size": -5.0, "gamma.size": 5.0}
    y = design.readings(sizes, design.typical_noise())
    by_name = {score.effect: score for score in compared(design, y).screening.scores}
    left = design.left_over(y, NUISANCES)
    assert by_name["alpha"].gain == pytest.approx(design.chi2(y) - design.chi2(y, ["alpha"]), rel=1e-8)
    for name in ("beta", "gamma"):
        z = float(design.signature(f"{name}.size") @ left)
        assert by_name[name].gain == pytest.approx(max(z, 0.0) ** 2, rel=1e-8)


def test_an_effect_absorbed_by_the_fitted_parameters_is_untestable() -> None:
    design = made_design(PLAIN[:3], np.eye(3))
    mixed = 2.0 * design.columns["gain"] - 3.0 * design.columns["slope"]
    design = replace(design, columns={**design.columns, "gamma.size": mixed})
    found = compared(design, design.readings({"gamma.size": 50.0}, design.typical_noise()))
    assert found.screening.untestable == ("gamma",)
    assert found.adequate


def alone(
    found: ModelComparison, rng: np.random.Generator, shifts: Sequence[float] | None = None
) -> Projected:
    """The same linearisation with new noise, plus `shifts` sigmas of each candidate."""
    lin = found.linearisation
    return project(_with_residuals(lin, rng, shifts))


def _with_residuals(
    lin: Linearisation, rng: np.random.Generator, shifts: Sequence[float] | None
) -> Linearisation:
    """The residual of a triangle is N(0, 1) in its rows and √χ² of the remaining values in the last."""
    records = []
    for one in lin.records:
        rows = one.residual.size - 1
        drawn = np.append(rng.standard_normal(rows), np.sqrt(rng.chisquare(one.count - rows)))
        if shifts is not None:
            drawn = drawn + one.signatures @ np.asarray(shifts)
        records.append(replace(one, residual=drawn))
    return replace(lin, records=tuple(records))


def within_chance(hits: int, draws: int, rate: float) -> bool:
    """A correct rate is rejected once in a thousand times."""
    return bool(binomtest(hits, draws, rate).pvalue > 1e-3)


DRAWS = 2000


def test_each_adequacy_test_rejects_a_correct_model_at_its_nominal_level() -> None:
    """Each at 1 % (plane test, χ², best of six scores), and all three together at no more than 1 %."""
    rng = np.random.default_rng(5)
    design = made_design(PLAIN, random_gram(rng, 6, 9), correlation=0.3)
    found = compared(design, design.readings({}, design.typical_noise()))
    null = null_of_best(found.projected)
    rejected = dict.fromkeys(("together", "score", "plane", "chi2"), 0)
    for _ in range(DRAWS):
        here = alone(found, rng)
        tests = adequacy(here, screen(here, null=null))
        rejected["together"] += not tests.agrees
        for name, test in tests.tests.items():
            rejected[name] += test.p_value < ALPHA
    for name in ("score", "plane", "chi2"):
        assert within_chance(rejected[name], DRAWS, ALPHA), (name, rejected)
    assert rejected["together"] <= rejected["score"] + rejected["plane"] + rejected["chi2"]
    assert binomtest(rejected["together"], DRAWS, ALPHA, alternative="greater").pvalue > 1e-3


@pytest.mark.parametrize("signs", [0, 1])
def test_the_p_value_of_the_best_of_independent_scores_is_family_wise(signs: int) -> None:
    """p = 1 − (1 − p₁)^K from simulated draws; below their resolution, K·p₁."""
    effects = [
        made_effect(name, parameters=(made_parameter("size", low=-1e4 if not signs else 0.0),))
        for name in NAMES
    ]
    design = made_design(effects, np.eye(6))
    for size in (2.0, 2.8, 3.3, 5.0, 9.0):
        found = compared(design, design.readings({"alpha.size": size}, design.typical_noise()))
        best = found.screening.scores[0]
        assert best.effect == "alpha"
        assert best.z == pytest.approx(size, rel=1e-6)
        single = norm.sf(size) if signs else 2.0 * norm.sf(size)
        exact = 1.0 - (1.0 - single) ** 6
        if exact * 20_000 > 40:
            assert best.p_value == pytest.approx(exact, abs=4.0 * np.sqrt(exact / 20_000))
        else:
            assert best.p_value == pytest.approx(6.0 * single, rel=1e-9)


@pytest.mark.parametrize("size", [2.0, 3.0, 4.0])
def test_the_power_of_a_score_matches_the_noncentral_chi_squared(size: float) -> None:
    """One candidate, at a level of 1 %: P(χ²₁(λ²) > χ²₁⁻¹(0.99))."""
    design = made_design(PLAIN[:1], np.eye(1), correlation=0.3)
    found = compared(design, design.readings({}, design.typical_noise()))
    null = null_of_best(found.projected)
    rng = np.random.default_rng(6)
    seen = sum(screen(alone(found, rng, [size]), null=null).p_value < ALPHA for _ in range(500))
    exact = ncx2.sf(chi2.isf(ALPHA, 1), 1, size**2)
    assert within_chance(seen, 500, exact)


def seen_with(library: int) -> float:
    """The power at the detection limit for one effect of a library of this size."""
    return float(norm.sf(norm.isf(0.5 * ALPHA / 3.0 / library) - SEEN_IN_LIBRARY))


def test_the_power_at_the_detection_limit_is_as_predicted() -> None:
    """Of a library of 12, beside two other tests: Φ(4.5 − z) with z the quantile of 0.01/3/12."""
    effects = [made_effect(f"effect_{k}") for k in range(12)]
    design = made_design(effects, np.eye(12))
    found = compared(design, design.readings({}, design.typical_noise()))
    null = null_of_best(found.projected)
    rng = np.random.default_rng(7)
    shifts = [SEEN_IN_LIBRARY, *([0.0] * 11)]
    seen = sum(3.0 * screen(alone(found, rng, shifts), null=null).p_value < ALPHA for _ in range(400))
    assert within_chance(seen, 400, seen_with(12))
    assert seen_with(12) == pytest.approx(0.81, abs=0.01)
    assert seen_with(50) == pytest.approx(0.70, abs=0.01)


def test_effects_below_the_detection_limit_at_their_typical_size_are_listed() -> None:
    """‖s̃‖·|φ_typical| on either side of 4.5 sigmas; one parameter of two is enough."""
    lengths = np.array([4.4, 4.6, 1.0, 4.6])
    effects = [
        made_effect("alpha"),
        made_effect("beta"),
        made_effect("gamma", parameters=(made_parameter("size"), made_parameter("rate"))),
    ]
    design = made_design(effects, np.diag(lengths**2))
    found = compared(design, design.readings({}, design.typical_noise()))
    assert hidden_at_typical_size(found.projected) == ("alpha",)
    halved = [
        replace(one, parameters=tuple(replace(p, start=0.5) for p in one.parameters)) for one in effects
    ]
    design = replace(design, effects=tuple(halved))
    found = compared(design, design.readings({}, design.typical_noise()))
    assert hidden_at_typical_size(found.projected) == ("alpha", "beta", "gamma")


def scored(design: Design, y: Floats) -> dict[str, tuple[float, float, float]]:
    found = compared(design, y).screening
    return {score.effect: (score.gain, score.p_value, score.kappa) for score in found.scores}


def same(one: dict[str, tuple[float, float, float]], other: dict[str, tuple[float, float, float]]) -> bool:
    """Gains and κ to rounding; p-values to within the scatter of their simulation."""
    return one.keys() == other.keys() and all(
        np.allclose(one[name][::2], other[name][::2], rtol=1e-6)
        and abs(one[name][1] - other[name][1]) <= 0.01 + 0.05 * one[name][1]
        for name in one
    )


@settings(max_examples=4)
@given(st.permutations(range(6)), st.integers(0, 2**31))
def test_scores_do_not_depend_on_the_order_of_the_effects(order: list[int], seed: int) -> None:
    rng = np.random.default_rng(seed)
    design = made_design(PLAIN, random_gram(rng, 6, 9))
    y = design.readings({"beta.size": 4.0}, design.drawn_noise(rng))
    shuffled = replace(design, effects=tuple(design.effects[k] for k in order))
    assert same(scored(design, y), scored(shuffled, y))


@settings(max_examples=4)
@given(st.floats(-6.0, 6.0), st.integers(0, 2**31))
def test_scores_do_not_depend_on_the_unit_of_a_parameter(exponent: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    design = made_design(PLAIN, random_gram(rng, 6, 9))
    y = design.readings({"beta.size": 4.0}, design.drawn_noise(rng))
    unit = 10.0**exponent
    (parameter,) = PLAIN[1].parameters
    written = replace(
        parameter, start=parameter.start / unit, low=parameter.low / unit, high=parameter.high / unit
    )
    effects = [replace(one, parameters=(written,)) if one.name == "beta" else one for one in design.effects]
    columns = {**design.columns, "beta.size": unit * design.columns["beta.size"]}
    assert same(scored(design, y), scored(replace(design, effects=tuple(effects), columns=columns), y))


@settings(max_examples=4)
@given(st.integers(0, 2**31))
def test_scores_do_not_depend_on_the_basis_of_the_nuisance_parameters(seed: int) -> None:
    """Any other basis of the space that they span."""
    rng = np.random.default_rng(seed)
    design = made_design(PLAIN, random_gram(rng, 6, 9))
    y = design.readings({"beta.size": 4.0}, design.drawn_noise(rng))
    mixed = design.matrix(NUISANCES) @ (rng.standard_normal((3, 3)) + 3.0 * np.eye(3))
    turned = replace(design, columns={**design.columns, **dict(zip(NUISANCES, mixed.T, strict=True))})
    assert same(scored(design, y), scored(turned, y))


@settings(max_examples=4)
@given(st.lists(st.floats(0.0, 12.0), min_size=2, max_size=4), st.integers(0, 4))
def test_a_larger_effect_has_no_smaller_gain_and_no_larger_p_value(sizes: list[float], seed: int) -> None:
    design = made_design(PLAIN[:1], np.eye(1))
    noise = design.typical_noise(seed)
    found = [scored(design, design.readings({"alpha.size": size}, noise))["alpha"] for size in sorted(sizes)]
    gains, levels = [one[0] for one in found], [one[1] for one in found]
    assert all(after >= before - 1e-6 for before, after in pairwise(gains))
    assert all(after <= before + 1e-12 for before, after in pairwise(levels))
