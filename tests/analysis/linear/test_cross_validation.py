"""Cross-validation of an effect on synthetic records with one column for each unknown."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from rigctl.analysis.linear.cross_validation import held_out_gain
from rigctl.analysis.linear.linearisation import Linearisation, RecordTriangle
from rigctl.analysis.linear.nuisance_projection import HIDDEN
from rigctl.analysis.linear.regions import Regions

ROWS = 40


def linearised(
    acts: np.ndarray, residual: np.ndarray, names: tuple[str, ...] = ("gain", "leak.size")
) -> Linearisation:
    """Eight conditions of one record each; one unknown acts everywhere, the effect as `acts` (8, rows)."""
    rng = np.random.default_rng(3)
    triangles = tuple(
        RecordTriangle(
            np.column_stack([rng.standard_normal(ROWS), own])[:, : len(names)],
            np.empty((ROWS, 0)),
            np.empty((ROWS, 0)),
            left,
            ROWS,
        )
        for own, left in zip(acts, residual, strict=True)
    )
    records = [SimpleNamespace(run="r", label=str(k)) for k in range(len(acts))]
    fit: Any = SimpleNamespace(
        problem=SimpleNamespace(measurements=SimpleNamespace(table=False), records=records),
        fitted=tuple(range(len(acts))),
    )
    regions = SimpleNamespace(conditions=np.arange(float(len(acts)))[:, None])
    return Linearisation(
        fit,
        (),
        (),
        names,
        cast("Regions", regions),
        triangles,
        np.empty(0),
        (np.zeros((len(names), len(names))), np.zeros(len(names))),
    )


def noise(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal((8, ROWS))


@pytest.mark.parametrize("seed", range(5))
def test_an_effect_that_acts_in_every_record_predicts_held_out_records(seed: int) -> None:
    check = held_out_gain(linearised(noise(100 + seed), noise(seed)), ["leak.size"], [1.0])
    assert check.passed
    assert check.folds == 8
    assert check.after < check.before


@pytest.mark.parametrize("seed", range(5))
def test_an_effect_that_acts_in_few_conditions_need_not_improve_the_others(seed: int) -> None:
    acts = noise(100 + seed) * np.array([0.0] * 5 + [0.3, 1.0, 4.0])[:, None]
    check = held_out_gain(linearised(acts, noise(seed)), ["leak.size"], [1.0])
    assert check.mean < 2.0 * check.error  # its gains scatter by as much as they are
    assert check.passed


@pytest.mark.parametrize("seed", range(5))
def test_an_effect_whose_size_differs_between_conditions_fails_cross_validation(seed: int) -> None:
    """The fitted mean is 1; the size is 3 in half of the conditions and -1 in the others."""
    acts = noise(100 + seed)
    sizes = np.array([3.0, -1.0] * 4)[:, None]
    check = held_out_gain(linearised(acts, noise(seed) + (sizes - 1.0) * acts), ["leak.size"], [1.0])
    assert check.least < -3.0
    assert not check.passed


def test_a_fold_that_fails_by_linearisation_is_decided_by_a_refit() -> None:
    """Only failed folds are refitted, and the refit decides; without one the linear result is used."""
    acts = noise(100)
    residual = noise(0) + (np.array([3.0, -1.0] * 4)[:, None] - 1.0) * acts
    asked: list[tuple[int, ...]] = []

    def refitted(fold: Sequence[int]) -> tuple[float, float]:
        asked.append(tuple(fold))
        return 10_000.0, 40.0

    plain = held_out_gain(linearised(acts, residual), ["leak.size"], [1.0])
    again = held_out_gain(linearised(acts, residual), ["leak.size"], [1.0], refitted=refitted)
    assert not plain.passed
    assert again.passed
    assert asked
    assert len(asked) < 8
    none = held_out_gain(linearised(acts, residual), ["leak.size"], [1.0], refitted=lambda _: None)
    assert none == plain


def test_a_fold_that_leaves_no_record_showing_the_effect_is_not_counted() -> None:
    acts = noise(7) * np.array([0.0] * 7 + [5.0])[:, None]
    check = held_out_gain(linearised(acts, noise(8)), ["leak.size"], [1.0])
    assert check.folds == 7  # not the one without the record that shows it


def test_an_effect_fitted_at_its_bound_is_evaluated_at_that_size() -> None:
    acts = noise(9)
    lin = linearised(acts, noise(10), names=("gain",))
    assert held_out_gain(lin, ["leak.size"], [1.0]).mean == pytest.approx(0.0)
    assert held_out_gain(lin, ["leak.size"], [1.0], list(acts)).passed
    assert not held_out_gain(lin, ["leak.size"], [1.0], list(0.0 * acts)).passed


# --- against dense least squares


def problem(
    columns: Sequence[np.ndarray],
    residuals: Sequence[np.ndarray],
    names: tuple[str, ...],
    conditions: np.ndarray,
    *,
    runs: Sequence[str] = (),
    prior: tuple[np.ndarray, np.ndarray] | None = None,
    table: bool = False,
    counts: Sequence[int] = (),
) -> Linearisation:
    """Records of these columns and residuals; `counts` are the readings of each."""
    none = np.empty((0, 0))
    triangles = tuple(
        RecordTriangle(one, none, none, left, count)
        for one, left, count in zip(
            columns, residuals, counts or [left.size for left in residuals], strict=True
        )
    )
    several = runs or ["r"] * len(triangles)
    records = [SimpleNamespace(run=run, label=str(k)) for k, run in enumerate(several)]
    measurements = SimpleNamespace(table=table)
    fit: Any = SimpleNamespace(
        problem=SimpleNamespace(
            measurements=measurements, records=records, compiled=SimpleNamespace(cascade=None)
        ),
        fitted=tuple(range(len(records))),
    )
    regions = cast("Regions", SimpleNamespace(conditions=conditions))
    no_prior = np.zeros((len(names), len(names))), np.zeros(len(names))
    return Linearisation(fit, (), (), names, regions, triangles, np.empty(0), prior or no_prior)


POINTS = np.array([(t, p) for t in (0.0, 1.0, 2.0, 3.0) for p in (-1.0, 1.0)])
#: each temperature, each pressure, and each run
FOLDS = [*([2 * k, 2 * k + 1] for k in range(4)), [0, 2, 4, 6], [1, 3, 5, 7], [0, 1, 2], [3, 4, 5, 6, 7]]
RUNS = ["one"] * 3 + ["two"] * 5


@pytest.mark.parametrize("unit", [1.0, 1e-9, 1e9])
@pytest.mark.parametrize("close", [1.0, 1e-4])
@pytest.mark.parametrize("size", [1.0, 4.0])
def test_every_gain_is_that_of_least_squares_without_the_fold(unit: float, close: float, size: float) -> None:
    """With a prior, an unknown that nothing shows, two that act nearly alike, and any unit of one of them."""
    rng = np.random.default_rng(2)
    names = ("gain", "nothing", "near", "leak.size", "leak.rate")
    columns = [rng.standard_normal((10 + k, 5)) for k in range(8)]
    for one in columns:
        one[:, 1] = 0.0
        one[:, 2] = one[:, 0] + close * one[:, 2]
    sizes = np.array([size, -0.5])
    wrong = [(1.0, -2.0)[k % 3 == 0] for k in range(8)]  # another size in three records
    held = [0.3 * rng.standard_normal(len(one)) for one in columns]
    residuals = [
        rng.standard_normal(len(one)) + by * one[:, 3] for one, by in zip(columns, wrong, strict=True)
    ]
    weight, prior = np.diag([0.5, 0.0, 0.0, 0.2, 0.0]), np.array([0.4, 0.0, 0.0, -0.3, 0.0])
    off = [r + c[:, 3:] @ sizes + h for r, c, h in zip(residuals, columns, held, strict=True)]

    def outside(which: Sequence[np.ndarray], free: list[int], fold: list[int]) -> np.ndarray:
        inside = [k for k in range(8) if k not in fold]
        matrix = np.vstack([*(columns[k] for k in inside), weight])[:, free]
        step = np.linalg.pinv(matrix, rcond=1e-12) @ np.concatenate([*(which[k] for k in inside), prior])
        return np.concatenate([which[k] - columns[k][:, free] @ step for k in fold])

    with_it = [outside(residuals, [0, 2, 3, 4], fold) for fold in FOLDS]
    without = [outside(off, [0, 2], fold) for fold in FOLDS]
    squares = np.array([(a @ a, b @ b) for a, b in zip(without, with_it, strict=True)])
    gains = squares[:, 0] - squares[:, 1]
    spreads = np.array([2.0 * np.linalg.norm(a - b) for a, b in zip(without, with_it, strict=True)])
    rows = sum(len(one) for one in with_it)
    asked: list[list[int]] = []

    def refitted(fold: Sequence[int]) -> None:
        asked.append(list(fold))

    scaled = [one * np.array([1.0, 1.0, unit, 1.0, 1.0]) for one in columns]
    lin = problem(scaled, residuals, names, POINTS, runs=RUNS, prior=(weight, prior))
    found = held_out_gain(lin, ["leak.size", "leak.rate"], sizes, held, refitted)
    assert (found.folds, found.before, found.after) == (
        8,
        pytest.approx(np.sqrt(squares[:, 0].sum() / rows), rel=1e-5),
        pytest.approx(np.sqrt(squares[:, 1].sum() / rows), rel=1e-5),
    )
    assert found.mean == pytest.approx(gains.mean(), rel=1e-5)
    assert found.error == pytest.approx(gains.std(ddof=1) / np.sqrt(8), rel=1e-5)
    assert found.sure == pytest.approx(gains.sum() / np.sqrt(spreads @ spreads), rel=1e-5)
    assert found.least == pytest.approx((gains / spreads).min(), rel=1e-5)
    assert asked == [fold for fold, gain, by in zip(FOLDS, gains, spreads, strict=True) if gain < -3.0 * by]


def folds_of(conditions: np.ndarray, runs: Sequence[str] = ()) -> int:
    rng = np.random.default_rng(1)
    columns = [5.0 * rng.standard_normal((20, 1)) for _ in conditions]
    residuals = [rng.standard_normal(20) for _ in conditions]
    return held_out_gain(problem(columns, residuals, ("a",), conditions, runs=runs), ["a"], [1.0]).folds


def test_conditions_are_left_out_then_runs_and_records_only_where_all_are_alike() -> None:
    alike = np.ones((6, 2))
    assert folds_of(alike) == 6
    assert folds_of(alike, ["one"] * 3 + ["two"] * 3) == 2
    two = np.column_stack([np.ones(6), [1.0] * 4 + [2.0] * 2])
    assert folds_of(two) == 2
    assert folds_of(two, ["one"] * 4 + ["two"] * 2) == 2  # the same records are left out once
    assert folds_of(two, ["one"] * 3 + ["two"] * 3) == 4
    assert folds_of(np.arange(3.0)[:, None]) == 3
    assert folds_of(np.arange(2.0)[:, None]) == 2
    assert folds_of(np.empty((4, 0))) == 4


def test_one_fold_that_counts_and_records_without_readings_show_nothing() -> None:
    rng = np.random.default_rng(1)
    columns = [np.zeros((20, 1)), 5.0 * rng.standard_normal((20, 1))]
    residuals = [rng.standard_normal(20) for _ in columns]
    steps = np.arange(2.0)[:, None]
    one = held_out_gain(problem(columns, residuals, ("a",), steps), ["a"], [1.0])
    assert (one.folds, one.mean, one.error, one.passed) == (1, 0.0, 0.0, False)
    assert np.isnan([one.before, one.after]).all()
    again = [columns[1]] * 2
    none = held_out_gain(problem(again, residuals, ("a",), steps, counts=[0, 0]), ["a"], [1.0])
    assert (none.folds, none.mean) == (2, 0.0)
    assert np.isnan(none.before)


@pytest.mark.parametrize(("size", "folds"), [(1.9, 0), (2.1, 4)])
@pytest.mark.parametrize("amplitude", [1.0, 0.1])
@pytest.mark.parametrize("beside", [False, True])
def test_a_fold_counts_if_the_others_show_two_sigmas_of_the_effect(
    size: float, folds: int, amplitude: float, beside: bool
) -> None:
    """Three of four records are left, and of them what no other unknown does as well."""
    of_each = size / np.sqrt(3.0) / amplitude
    columns = [np.array([[0.0], [of_each], [0.0]])] * 4
    names: tuple[str, ...] = ("leak.size",)
    if beside:  # an unknown that does the same but for the part that counts, in a small unit
        columns = [np.column_stack([[1e-6, 0.0, 0.0], [7.0, of_each, 0.0]])] * 4
        names = ("gain", "leak.size")
    lin = problem(columns, [np.zeros(3)] * 4, names, np.arange(4.0)[:, None])
    assert held_out_gain(lin, ["leak.size"], [amplitude]).folds == folds


@pytest.mark.parametrize(("share", "folds"), [(0.9, 3), (1.1, 4)])
def test_a_row_of_a_table_counts_if_the_others_determine_every_parameter(share: float, folds: int) -> None:
    """However small the effect is; all parameters, and each to more than a share of what all rows show."""
    left = share * HIDDEN
    columns = [np.array([[0.01, 0.0], [0.0, own]]) for own in (1.0, left, 0.0, 0.0)]
    conditions = np.arange(4.0)[:, None]
    lin = problem(columns, [np.zeros(2)] * 4, ("a.size", "a.rate"), conditions, table=True)
    assert held_out_gain(lin, ["a.size", "a.rate"], [1e-3, 1e-3]).folds == folds


def test_an_effect_that_changes_no_prediction_is_neither_refitted_nor_of_any_loss() -> None:
    rng = np.random.default_rng(1)
    columns = [np.zeros((5, 1)), np.zeros((5, 1)), *(4.0 * np.eye(5)[:, :1] for _ in range(3))]
    residuals = [rng.standard_normal(5) for _ in columns]
    lin = problem(columns, residuals, ("a",), np.arange(5.0)[:, None])

    def refitted(fold: Sequence[int]) -> None:
        pytest.fail("nothing was predicted wrongly")

    check = held_out_gain(lin, ["a"], [5.0], refitted=refitted)
    assert (check.folds, check.least) == (5, 0.0)
    bound = held_out_gain(lin, ["b"], [5.0], refitted=refitted)  # it is at its bound, and no fit moves it
    assert (bound.folds, bound.mean, bound.sure, bound.least) == (5, 0.0, 0.0, 0.0)
