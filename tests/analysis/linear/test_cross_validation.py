"""Cross-validation of an effect on synthetic records with one column for each unknown."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from rigctl.analysis.linear.cross_validation import held_out_gain
from rigctl.analysis.linear.linearisation import Linearisation, RecordTriangle
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
