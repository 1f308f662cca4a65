"""Distances between rivals compared with closed forms and with explicit least squares."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from rigctl.design.information import Evidence, Refit, Response

Floats = NDArray[np.float64]


def problem(seed: int, rows: int = 40, shared: int = 3, own: int = 2) -> tuple[Response, Response, Floats]:
    """Two rivals' responses to one record, and the information on the second one's shared parameters."""
    rng = np.random.default_rng(seed)
    one = Response(rng.normal(size=rows), rng.normal(size=(rows, shared + 1)), rng.normal(size=(rows, own)))
    other = Response(rng.normal(size=rows), rng.normal(size=(rows, shared)), rng.normal(size=(rows, own)))
    root = rng.normal(size=(shared, shared))
    return one, other, root @ root.T + 0.1 * np.eye(shared)


def refitted(difference: Floats, columns: Floats, own: Floats, known: Floats) -> float:
    """min over θ, l of |Δ − Jθ − Ll|² + θᵀIθ + lᵀl, with the information stacked as rows."""
    count, shared = own.shape[1], columns.shape[1]
    root = np.linalg.cholesky(known).T
    matrix = np.block(
        [
            [columns, own],
            [root, np.zeros((shared, count))],
            [np.zeros((count, shared)), np.eye(count)],
        ]
    )
    target = np.concatenate([difference, np.zeros(shared + count)])
    found = np.linalg.lstsq(matrix, target, rcond=None)[0]
    return float(np.sum(np.square(target - matrix @ found)))


@pytest.mark.parametrize("seed", range(5))
def test_the_distance_is_the_remainder_after_the_rival_is_refitted(seed: int) -> None:
    one, other, known = problem(seed)
    found = Evidence.of([one, other]).distances([np.eye(4), known])
    expected = refitted(one.predicted - other.predicted, other.shared, other.own, known)
    assert found[0, 1] == pytest.approx(expected, rel=1e-9)
    assert found[0, 0] == found[1, 1] == 0.0


def test_the_evidence_of_two_records_adds_up_to_their_joint_distance() -> None:
    (one, other, known), (more, rest, _) = problem(1), problem(2)
    whole = Evidence.of([one, other]) + Evidence.of([more, rest])
    difference = np.concatenate([one.predicted - other.predicted, more.predicted - rest.predicted])
    own = np.zeros((80, 4))
    own[:40, :2], own[40:, 2:] = other.own, rest.own
    expected = refitted(difference, np.vstack([other.shared, rest.shared]), own, known)
    assert whole.distances([np.eye(4), known])[0, 1] == pytest.approx(expected, rel=1e-9)


def test_a_difference_that_the_rival_can_fit_adds_no_distance() -> None:
    """A difference along the rival's derivatives counts only as far as its parameters are known."""
    rng = np.random.default_rng(0)
    columns = rng.normal(size=(30, 2))
    here = Response(columns @ [1.0, -2.0], np.zeros((30, 0)), np.zeros((30, 0)))
    there = Response(np.zeros(30), columns, np.zeros((30, 0)))
    vague, sure = 1e-9 * np.eye(2), 1e9 * np.eye(2)
    evidence = Evidence.of([here, there])
    assert evidence.distances([np.zeros((0, 0)), vague])[0, 1] == pytest.approx(0.0, abs=1e-6)
    plain = float(here.predicted @ here.predicted)
    assert evidence.distances([np.zeros((0, 0)), sure])[0, 1] == pytest.approx(plain, rel=1e-6)


def test_a_joint_refit_gives_the_same_distance_as_the_summed_evidence() -> None:
    (one, other, known), (more, rest, _) = problem(3), problem(4)
    difference = np.concatenate([one.predicted - other.predicted, more.predicted - rest.predicted])
    left = Refit.of([other, rest], known).left(difference)
    whole = Evidence.of([one, other]) + Evidence.of([more, rest])
    assert difference @ left == pytest.approx(whole.distances([np.eye(4), known])[0, 1], rel=1e-9)
