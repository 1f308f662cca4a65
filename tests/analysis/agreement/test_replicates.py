"""Whether records of one condition agree: the level of the test, and what it measures."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.stats import kstest

from rigctl.analysis.agreement.replicates import replicate_test

READINGS, REGIONS = 96, 6
GROUPS = (0, 0, 0, 1, 1, 2, 2, 2, 3)


def linearised(
    rng: np.random.Generator,
    *,
    common: float = 0.0,
    each: float = 0.0,
    noise: float = 1.0,
    pattern: float = 0.0,
) -> Any:
    """Records with two own unknowns projected off, a misfit common to each condition, and one of each record.

    The unknowns of the records of one condition act alike. `pattern` is a misfit whose sum over each region
    is zero.
    """
    regions = np.repeat(np.eye(REGIONS), READINGS // REGIONS, axis=0) / np.sqrt(READINGS // REGIONS)
    own = {group: rng.standard_normal((READINGS, 2)) + 3.0 * regions[:, :2] for group in set(GROUPS)}
    shared = {group: regions @ rng.standard_normal(REGIONS) for group in set(GROUPS)}
    records = []
    for group in GROUPS:
        basis = np.linalg.qr(own[group])[0]
        residual = noise * rng.standard_normal(READINGS) + common * shared[group]
        residual += each * (regions @ rng.standard_normal(REGIONS))
        residual += pattern * np.tile([1.0, -1.0], READINGS // 2)
        records.append(
            SimpleNamespace(
                regions=regions - basis @ (basis.T @ regions),
                residual=residual - basis @ (basis.T @ residual),
                count=READINGS - 2,
            )
        )
    return SimpleNamespace(records=records, regions=SimpleNamespace(groups=GROUPS))


@pytest.mark.parametrize("common", [0.0, 50.0])
def test_its_p_value_is_uniform_where_records_of_one_condition_agree(common: float) -> None:
    """Also with unknowns of each record, which reduce the variance of the sums over phases and channels."""
    rng = np.random.default_rng(3)
    found = []
    for _ in range(1500):
        tested = replicate_test(linearised(rng, common=common))
        assert tested is not None
        found.append(tested.p_value)
    assert kstest(found, "uniform").pvalue > 0.01


def test_noise_that_is_itself_estimated_makes_it_less_certain() -> None:
    rng = np.random.default_rng(4)
    found = []
    for _ in range(1500):
        scale = np.sqrt(
            rng.chisquare(4) / 4
        )  # the noise that it is told is 1; the records have it times 1/scale
        tested = replicate_test(linearised(rng, noise=1.0 / scale), known=4)
        assert tested is not None
        found.append(tested.p_value)
    assert kstest(found, "uniform").pvalue > 0.01


def test_the_share_that_differs_from_record_to_record() -> None:
    rng = np.random.default_rng(5)

    def shares(common: float, each: float) -> float:
        tests = [replicate_test(linearised(rng, common=common, each=each)) for _ in range(40)]
        assert all(one is not None and (one.p_value < 1e-6) is (each > 0.0) for one in tests)
        return float(np.mean([one.share for one in tests if one is not None]))

    assert shares(20.0, 0.0) < 0.05
    assert shares(0.0, 20.0) > 0.85
    assert 0.4 < shares(20.0, 20.0) < 0.8


def test_a_difference_by_chance_is_a_small_share_of_a_misfit_that_the_sums_do_not_show() -> None:
    """With the sums alone it would be all of it, and one search in a hundred would be refused for nothing."""
    rng = np.random.default_rng(7)
    tests = [replicate_test(linearised(rng, pattern=3.0)) for _ in range(200)]
    assert max(one.share for one in tests if one is not None) < 0.1


def test_conditions_of_one_record_each_have_nothing_to_compare() -> None:
    one = linearised(np.random.default_rng(6))
    one.regions.groups = tuple(range(len(GROUPS)))
    assert replicate_test(one) is None
