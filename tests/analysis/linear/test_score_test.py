"""The score tests' arithmetic against independent calculations."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import nnls
from scipy.stats import chi2, f

from rigctl.analysis.agreement.adequacy import Test
from rigctl.analysis.decision_levels import ALPHA
from rigctl.analysis.linear.candidates import Candidate
from rigctl.analysis.linear.chi_square import chi2_tail
from rigctl.analysis.linear.linearisation import Linearisation, RecordTriangle
from rigctl.analysis.linear.nuisance_projection import project
from rigctl.analysis.linear.regions import Regions
from rigctl.analysis.linear.score_test import cone, screen, tail
from rigctl.effects.registry import library
from rigctl.engine.least_squares import Unknown
from rigctl.physics.families import find_family


@settings(max_examples=60)
@given(st.integers(1, 3), st.integers(0, 2**31))
def test_the_gain_over_a_cone_is_that_of_non_negative_least_squares(count: int, seed: int) -> None:
    """max 2θᵀz − θᵀCθ over θ ≥ 0 is the fall of |r|² by the non-negative fit of r on the columns."""
    rng = np.random.default_rng(seed)
    columns = rng.standard_normal((8, count))
    columns /= np.linalg.norm(columns, axis=0)
    residual = rng.standard_normal(8)
    theta, left = nnls(columns, residual)
    gain, sizes = cone((columns.T @ residual)[None, :], columns.T @ columns, [1] * count)
    assert gain[0] == pytest.approx(float(residual @ residual) - left**2, abs=1e-9)
    assert sizes[0] == pytest.approx(theta, abs=1e-9)


@settings(max_examples=40)
@given(st.integers(1, 3), st.integers(0, 2**31))
def test_without_sign_constraints_the_gain_is_that_of_least_squares(count: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    columns = rng.standard_normal((8, count))
    residual = rng.standard_normal(8)
    fitted = columns @ np.linalg.lstsq(columns, residual, rcond=None)[0]
    gain, _ = cone((columns.T @ residual)[None, :], columns.T @ columns, [0] * count)
    assert gain[0] == pytest.approx(float(fitted @ fitted), rel=1e-8)


def test_a_one_sided_effect_gains_nothing_in_the_wrong_direction() -> None:
    gain, sizes = cone(np.array([[-3.0], [3.0]]), np.eye(1), [1])
    assert gain.tolist() == [0.0, pytest.approx(9.0)]
    assert sizes[0, 0] == 0.0


def test_tail_probabilities_agree_with_chi_squared() -> None:
    for gain in (0.5, 4.0, 20.0, 60.0):
        assert tail(np.array([gain]), [0])[0] == pytest.approx(chi2.sf(gain, 1), rel=1e-9)
        assert tail(np.array([gain]), [1])[0] == pytest.approx(0.5 * chi2.sf(gain, 1), rel=1e-9)
        assert tail(np.array([gain]), [0, 1])[0] == pytest.approx(chi2.sf(gain, 2), rel=1e-9)
        assert chi2_tail(gain, 7) == pytest.approx(chi2.sf(gain, 7), rel=1e-9)


def hidden(own: list[float], shared: list[float]) -> tuple[float, str]:
    """κ, and what absorbs an effect with the signature (3, 4, 12); `own` and `shared`: the absorbed parts."""
    signature = np.array([[3.0], [4.0], [12.0]])
    whole = float(np.linalg.norm(signature))
    left = signature - np.array(own)[:, None] * signature
    triangle = RecordTriangle(np.array(shared)[:, None], left, np.empty((3, 0)), np.ones(3), 3)
    effect = library(find_family("heater_board"))["radiation"]
    candidate = Candidate(effect, ("radiation.area",), (0,), {})
    fit: Any = SimpleNamespace(
        problem=SimpleNamespace(
            compiled=SimpleNamespace(cascade=None),
            measurements=SimpleNamespace(table=False),
            noise=SimpleNamespace(channels=()),
            shared=(Unknown("convection", 1.0),),
        )
    )
    lin = Linearisation(
        fit,
        (candidate,),
        (0,),
        ("convection",),
        cast("Regions", None),
        (triangle,),
        np.array([whole]),
        (np.zeros((1, 1)), np.zeros(1)),
    )
    score = screen(project(lin)).scores[0]
    return score.kappa, score.hidden_in


def test_an_effect_is_hidden_by_the_step_that_absorbs_most_of_it() -> None:
    nothing, last = [0.0, 0.0, 0.0], [0.0, 0.0, 1.0]
    assert hidden(nothing, last) == (pytest.approx(5.0 / 13.0), "convection")
    assert hidden(last, [0.0, 1.0, 0.0]) == (pytest.approx(3.0 / 13.0), "record")
    assert hidden([1.0, 0.0, 0.0], last) == (pytest.approx(4.0 / 13.0), "convection")


@pytest.mark.parametrize("known", [2, 4, 40])
def test_a_table_has_an_excess_exactly_if_its_test_rejects(known: int) -> None:
    """The excess uses the distribution of the p-value: with few degrees of freedom of the noise F, not χ²."""
    for statistic in (15.0, 30.0, 60.0, 200.0, 2000.0):
        p = chi2_tail(statistic, 10, known)
        assert (Test(statistic, p, 10, known=known).excess > 0.0) is (p < ALPHA)
    assert Test(1e6, 0.0, 10, known=known).excess == pytest.approx(1e6 - 10 * f.isf(ALPHA, 10, known))


def test_the_excess_of_records_is_counted_beyond_the_spread_of_chi_squared() -> None:
    assert Test(50.0, 0.0, 10, 4.0).excess == pytest.approx(50.0 - 10.0 - 2.33 * 4.0)
