"""What makes a fitted number uncertain: shares of its variance, against drawn errors of each source."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from rigctl.analysis.agreement.uncertainty_budget import READINGS, uncertainty_budgets
from rigctl.engine.least_squares import Prior, Unknown
from rigctl.model.fit.fit import FitResult
from rigctl.model.fit.stated_errors import StatedErrors
from rigctl.model.reading_errors import CalibrationError

READ = [CalibrationError("t", part, 0.2, 300.0, 30.0, "K") for part in ("zero", "gain")]
#: prior standard deviations; the first has none and is the number that is reported
STD = (np.inf, 0.2, 0.2, 0.3)


def fitted(covariance: np.ndarray) -> FitResult:
    """A fit with this covariance of a size, the errors of a thermometer, and an assumed resistance."""
    unknowns = (
        Unknown("size", 1.0, unit="W/K"),
        *(one.unknown for one in READ),
        Unknown("resistance", 1.0, prior=Prior(1.0, STD[3])),
    )
    fit = SimpleNamespace(
        solution=SimpleNamespace(unknowns=unknowns, covariance=covariance),
        reported_covariance=covariance,
        stated_errors=StatedErrors((), np.zeros((len(unknowns), 0))),
        problem=SimpleNamespace(
            measurements=SimpleNamespace(reading_errors=tuple(READ)),
            model=SimpleNamespace(fitted=("size",), assumed={"resistance": (0.5, 2.0)}),
        ),
        undetermined=frozenset(),
    )
    return cast("FitResult", cast("Any", fit))


def test_the_shares_are_those_of_drawn_errors() -> None:
    random = np.random.default_rng(11)
    columns = random.normal(size=(40, 4)) + np.outer(np.linspace(0.0, 1.0, 40), [3.0, 2.0, 1.0, 3.0])
    weight = np.array([0.0 if np.isinf(std) else 1.0 / std**2 for std in STD])
    covariance = np.linalg.inv(columns.T @ columns + np.diag(weight))
    (budget,) = uncertainty_budgets(fitted(covariance))

    # the estimate of the same linear problem, with one source of error at a time
    draws = 200_000
    of_noise = covariance @ columns.T @ random.normal(size=(40, draws))
    shares = {READINGS: float(np.var(of_noise[0]))}
    for k, source in ((1, "calibration of t"), (2, "calibration of t"), (3, "resistance (assumed)")):
        error = random.normal(0.0, STD[k], draws)  # true value less the prior's mean
        estimate = covariance[0] @ columns.T @ columns[:, [k]] * error
        shares[source] = shares.get(source, 0.0) + float(np.var(estimate))
    total = sum(shares.values())
    assert budget.std == pytest.approx(np.sqrt(total), rel=0.01)
    assert dict(budget.shares) == pytest.approx({name: one / total for name, one in shares.items()}, abs=0.01)
    assert list(budget.shares.values()) == sorted(budget.shares.values(), reverse=True)


def test_a_number_that_the_data_do_not_determine_has_none() -> None:
    covariance = np.eye(4)
    covariance[0, 0] = np.inf
    assert uncertainty_budgets(fitted(covariance)) == ()
