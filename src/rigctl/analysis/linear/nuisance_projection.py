"""A linearisation with the shared unknowns projected off."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.linear.linearisation import Linearisation, RecordTriangle
from rigctl.model.fit.fit import FitResult
from rigctl.noise import Source

Floats = NDArray[np.float64]

#: a signature of which less than this share is left after projection is not testable
HIDDEN = 1e-3
#: the same where derivatives are differences, which agree to about this
HIDDEN_IN_DIFFERENCES = 0.02
_RANK = 1e-8
#: degrees of freedom attributed to a guessed noise, by its source: a number in a rig file is good to a
#: quarter, a share of the readings to a half
_WORTH: dict[Source, int] = {
    "rig": 8,
    "quiet": 4,
    "residuals": 4,
    "differences": 4,
    "floor": 4,
    "replicates": 4,
    "assumed": 2,
}
#: at the end of a table's fit, squares that the unknowns could still remove, but only by steps so large that
#: the linearisation does not hold, or beyond their bounds
_STUCK = 9.0


@dataclass(frozen=True)
class Projected:
    """``(I − P_J)`` applied to all columns, over some of the records.

    Attributes
    ----------
    residual: (rows) r̃.
    signatures: (rows, columns) S̃.
    lengths: (columns) ‖s̃‖.
    kappa: (columns) ‖s̃‖/‖s‖: the share of a signature that the fitted unknowns cannot absorb;
        `after_record_local` the same for the record-level unknowns alone.
    coefficients: (nuisances, columns) ``J⁺S``: how the unknowns would move to imitate each signature.
    dof: degrees of freedom of r̃.
    """

    linearisation: Linearisation = field(repr=False)
    records: tuple[int, ...]
    residual: Floats
    signatures: Floats
    lengths: Floats
    kappa: Floats
    after_record_local: Floats
    coefficients: Floats
    basis: Floats = field(repr=False)
    dof: int

    @property
    def usable(self) -> NDArray[np.bool_]:
        """(columns) True if enough of a signature is left to be tested."""
        return self.kappa > least_share(self.linearisation.fit)

    @property
    def noise_degrees(self) -> int:
        """Degrees of freedom of the noise estimate; 0 if it counts as known.

        The samples of records determine their noise well enough; a handful of rows does not, and a guess is
        worth few degrees of freedom (`_WORTH`). Guessed channels of records count only if they hold most of
        the misfit.
        """
        problem = self.linearisation.fit.problem
        if not problem.measurements.table:
            return _guessed_degrees(self.linearisation.fit)
        known = [channel.degrees for channel in problem.noise.channels if channel.degrees]
        return min(known) if known else 0

    def project(self, columns: Floats) -> Floats:
        """``(I − P_J)`` of columns given in the records' rows; the priors' rows are added."""
        padded = np.vstack([columns, np.zeros((self.residual.size - columns.shape[0], columns.shape[1]))])
        return np.asarray(padded - self.basis @ (self.basis.T @ padded))


def least_share(fit: FitResult) -> float:
    """What has to be left of a signature for a test."""
    return HIDDEN if fit.problem.compiled.cascade is None else HIDDEN_IN_DIFFERENCES


def _guessed_degrees(fit: FitResult) -> int:
    """The worth of the records' guessed noise, if such channels hold most of the misfit beyond noise."""
    guessed = {one.name: _WORTH[one.source] for one in fit.problem.noise.channels if one.guessed}
    if not guessed:
        return 0
    beyond = {name: max(0.0, one.count * (one.nrmse**2 - 1.0)) for name, one in fit.errors.items()}
    counted = {name: degrees for name, degrees in guessed.items() if beyond.get(name, 0.0) > 0.0}
    if 2.0 * sum(beyond[name] for name in counted) <= sum(beyond.values()) or not counted:
        return 0
    return min(counted.values())


def project(linearisation: Linearisation, indices: Sequence[int] | None = None) -> Projected:
    """Project the shared unknowns off, over all fitted records or those at `indices` among them."""
    chosen = tuple(range(len(linearisation.records))) if indices is None else tuple(indices)
    records = [linearisation.records[k] for k in chosen]
    weight, prior = linearisation.prior
    # Rows of all records, then a row for each prior of a shared unknown. With Q an orthonormal basis of J: S̃
    # = S − Q·QᵀS and r̃ = r − Q·Qᵀr. At the end of a fit Qᵀr is 0, except for bounds and tolerances.
    nuisance = np.vstack([*(one.nuisance for one in records), weight])
    signatures = _stack(records, "signatures", weight.shape[0])
    residual = np.concatenate([*(one.residual for one in records), prior])
    basis, inverse = _span(nuisance)
    remaining = signatures - basis @ (basis.T @ signatures)
    full = linearisation.full_lengths
    # `signatures` has the record-level unknowns projected off already: the two ratios to the full length say
    # how much of a signature these absorb, and how much the shared ones absorb of the rest.
    after_all, after_local = np.linalg.norm(remaining, axis=0), np.linalg.norm(signatures, axis=0)
    explained = basis @ (basis.T @ residual)
    if linearisation.fit.problem.measurements.table and float(explained @ explained) > _STUCK:
        explained = np.zeros_like(explained)
    return Projected(
        linearisation=linearisation,
        records=chosen,
        residual=residual - explained,
        signatures=remaining,
        lengths=after_all,
        kappa=np.where(full > 0.0, after_all / np.where(full > 0.0, full, 1.0), 0.0),
        after_record_local=np.where(full > 0.0, after_local / np.where(full > 0.0, full, 1.0), 0.0),
        coefficients=inverse @ signatures,
        basis=basis,
        dof=sum(one.count for one in records) + int((np.diag(weight) > 0.0).sum()) - basis.shape[1],
    )


def _span(columns: Floats) -> tuple[Floats, Floats]:
    """(rows, rank) orthonormal basis of columns, each first scaled to unit length; and the pseudo-inverse."""
    lengths = np.linalg.norm(columns, axis=0)
    scaled = columns / np.where(lengths > 0.0, lengths, 1.0)
    if not scaled.shape[1]:
        return np.empty((columns.shape[0], 0)), np.zeros((0, columns.shape[0]))
    left, values, right = np.linalg.svd(scaled, full_matrices=False)
    good = values > _RANK * max(values[0], 1e-300)
    basis = left[:, good]
    inverse = (right[good].T / values[good]) @ basis.T
    return basis, inverse / np.where(lengths > 0.0, lengths, 1.0)[:, None]


def _stack(records: Sequence[RecordTriangle], name: str, more: int) -> Floats:
    parts = [getattr(one, name) for one in records]
    return np.vstack([*parts, np.zeros((more, parts[0].shape[1]))])
