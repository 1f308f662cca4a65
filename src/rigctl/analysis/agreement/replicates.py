"""Whether records of one condition differ from each other by more than noise, which no model explains."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.linear.chi_square import chi2_tail
from rigctl.analysis.linear.linearisation import Linearisation, RecordTriangle

Floats = NDArray[np.float64]

#: a direction that retains less than this share of its variance after the record's own unknowns is not judged
_LEAST_VARIANCE = 1e-3
#: relative rounding error of a sum of matrices
_ROUNDING = 1e-9


@dataclass(frozen=True)
class ReplicateTest:
    """The test that records of one condition agree.

    Attributes
    ----------
    p_value: of the differences between the records of the conditions that have several.
    share: of what the model leaves in these records beyond noise, by how much they differ: 1 if nothing of it
        is common to the records of a condition.
    """

    p_value: float
    share: float


def replicate_test(lin: Linearisation, known: int = 0) -> ReplicateTest | None:
    """Test that the records of each condition agree; None if no condition has two.

    With E_k the regions' unit columns of record k, its own unknowns projected off, and ``S_k = E_kᵀE_k``, a
    misfit b that is common to the records of a condition has ``s_k = E_kᵀr_k ~ N(S_k b, S_k)``. The
    differences are Cochran's Q,

        ``Q = Σ s_kᵀ S_k⁺ s_k − (Σ s_k)ᵀ (Σ S_k)⁺ (Σ s_k)``,

    χ² with ``Σ rank S_k − rank Σ S_k`` degrees of freedom. The shared unknowns move all records of a
    condition alike, so that their fit changes b only.

    Parameters
    ----------
    known: degrees of freedom of the noise; 0 if it counts as known.
    """
    members: dict[int, list[RecordTriangle]] = {}
    for record, group in zip(lin.records, lin.regions.groups, strict=True):
        members.setdefault(group, []).append(record)
    conditions = [_of_condition(records) for records in members.values() if len(records) > 1]
    total, common, total_degrees, common_degrees = np.sum(conditions, axis=0) if conditions else (0.0,) * 4
    degrees = int(total_degrees - common_degrees)
    if degrees < 1:
        return None
    differ = max(float(total - common), 0.0)
    # what is common takes degrees of freedom of the differences, by which these are smaller
    differences = max(differ - degrees, 0.0) * float(total_degrees) / degrees
    records = [record for of_one in members.values() if len(of_one) > 1 for record in of_one]
    misfit = sum(float(record.residual @ record.residual) - record.count for record in records)
    everything = max(misfit, float(total - total_degrees), 1e-12)  # the sums do not see every pattern
    return ReplicateTest(chi2_tail(differ, degrees, known), min(differences / everything, 1.0))


def _of_condition(records: Sequence[RecordTriangle]) -> tuple[float, float, int, int]:
    """(squares of all, of the common misfit, degrees of freedom of both) of one condition's records."""
    size = records[0].regions.shape[1]
    sum_of_sums, sum_of_squares = np.zeros(size), np.zeros((size, size))
    total, degrees = 0.0, 0
    for record in records:
        values, vectors = np.linalg.eigh(record.regions.T @ record.regions)
        kept = values > _LEAST_VARIANCE
        values, vectors = values[kept], vectors[:, kept]
        along = vectors.T @ (record.regions.T @ record.residual)
        total += float(np.sum(along**2 / values))
        degrees += int(kept.sum())
        sum_of_sums += vectors @ along
        sum_of_squares += (vectors * values) @ vectors.T
    values, vectors = np.linalg.eigh(sum_of_squares)
    kept = values > _ROUNDING * len(records)
    along = vectors[:, kept].T @ sum_of_sums
    return total, float(np.sum(along**2 / values[kept])), degrees, int(kept.sum())
