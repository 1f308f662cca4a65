"""What makes a fitted number uncertain: noise of the readings, calibrations, clocks, assumed numbers.

With J the derivatives of the whitened residuals and P the variances of the independent priors, the
covariance of all unknowns is ``C = (JᵀJ + P⁻¹)⁻¹``, and ``C = C·JᵀJ·C + C·P⁻¹·C``: the first term is what
the noise of the readings brings, and the second splits by prior, so that

    C_ii = noise + Σ_k C_ik²/P_k

holds exactly. A sensor of which only an uncertainty is stated is exact in the fit, and adds the square of the
shift that it makes (`rigctl.model.fit.stated_errors`). The priors of the unknowns of single records, such as
their settings, act like noise that averages out over records, and are left with it.
Source: JCGM 100:2008 (GUM), 5.1 and F.1.2.3, uncertainty budgets with correlated estimates.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from rigctl.engine.least_squares import LeastSquaresResult
from rigctl.model.fit.fit import FitResult

#: the source of what no prior brings
READINGS = "readings"
#: all sources together that are not named
OTHERS = "others"
#: a source with less of the variance is not named
_LEAST = 0.01


@dataclass(frozen=True)
class UncertaintyBudget:
    """The variance of one fitted number by source.

    Attributes
    ----------
    parameter: its name; `unit` of `std`, SI.
    std: standard deviation.
    shares: of the variance by source, the largest first; they add up to 1.
    """

    parameter: str
    unit: str
    std: float
    shares: Mapping[str, float]

    def document(self) -> dict[str, Any]:
        """Its machine-readable form."""
        return {"parameter": self.parameter, "std": self.std, "unit": self.unit, "shares": dict(self.shares)}


def uncertainty_budgets(fit: FitResult) -> tuple[UncertaintyBudget, ...]:
    """The budget of each free parameter of a fitted model that the data determine."""
    solution = fit.solution
    if solution is None:
        return ()
    lost, result = fit.undetermined, []
    for row, unknown in enumerate(solution.unknowns):
        variance = float(fit.reported_covariance[row, row])
        if unknown.name not in fit.problem.model.fitted or unknown.name in lost:
            continue
        if not 0.0 < variance < math.inf:
            continue
        # The priors' parts are computed, and the readings bring the rest of the variance: shares add up to 1.
        shares: dict[str, float] = {}
        for source, part in _parts(fit, solution, row):
            shares[source] = shares.get(source, 0.0) + part / variance
        named = {source: share for source, share in shares.items() if share >= _LEAST}
        small = sum(share for share in shares.values() if share < _LEAST)
        if small >= _LEAST:
            named[OTHERS] = small
        named[READINGS] = max(0.0, 1.0 - sum(named.values()))
        ordered = dict(sorted(named.items(), key=lambda item: -item[1]))
        result.append(UncertaintyBudget(unknown.name, unknown.unit, math.sqrt(variance), ordered))
    return tuple(result)


def _parts(fit: FitResult, solution: LeastSquaresResult, row: int) -> Iterator[tuple[str, float]]:
    """What each prior, and each sensor that was taken for exact, brings to the variance of one unknown."""
    assumed = fit.problem.model.assumed
    reading = {one.name: one.source for one in fit.problem.measurements.reading_errors}
    for column, other in enumerate(solution.unknowns):
        if other.prior is not None:
            source = reading.get(other.name, other.name)
            named = f"{source} (assumed)" if source in assumed else source
            yield named, (float(solution.covariance[row, column]) / other.prior.std) ** 2
    stated = fit.stated_errors
    for error, shift in zip(stated.errors, stated.shifts[row].tolist(), strict=True):
        yield error.source, shift**2
