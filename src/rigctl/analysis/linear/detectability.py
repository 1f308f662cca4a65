"""The size, to a model, of a change of the readings, and the effects whose signatures resemble it.

λ = ‖(I − P)·W·Δy‖, with P the projection on the columns of the fitted parameters and record-level unknowns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.linear.candidates import Candidate
from rigctl.analysis.linear.linearisation import Linearisation, record_local_rows
from rigctl.analysis.linear.nuisance_projection import least_share
from rigctl.analysis.linear.score_test import cone
from rigctl.analysis.linear.slopes import slopes_at
from rigctl.model.fit.problem import Problem

Floats = NDArray[np.float64]

_RANK = 1e-8


@dataclass(frozen=True)
class Unexplained:
    """The projection ``(I − P)·W`` of one linearisation, for changes of its records' readings.

    Attributes
    ----------
    problem: the fitted records.
    candidates: the effects whose signatures are known; `starts` the index of the first column of each.
    """

    problem: Problem = field(repr=False)
    candidates: tuple[Candidate, ...] = field(repr=False)
    starts: tuple[int, ...] = field(repr=False)
    _record_local: tuple[Floats, ...] = field(repr=False)
    _shared: Floats = field(repr=False)
    _signatures: Floats = field(repr=False)

    def of(self, changes: Sequence[Floats]) -> Floats:
        """(rows) the projected changes of the readings, each (n, outputs), SI, in the records' order."""
        rows = [
            _off_record_local(whitener(np.where(ok, change, 0.0)), record_local)
            for whitener, ok, change, record_local in zip(
                self.problem.whiteners, self.problem.ok, changes, self._record_local, strict=True
            )
        ]
        projected = np.concatenate(rows)
        projected = np.concatenate([projected, np.zeros(self._shared.shape[0] - projected.size)])
        return np.asarray(projected - self._shared @ (self._shared.T @ projected))

    def size(self, changes: Sequence[Floats]) -> float:
        """λ, in sigmas."""
        return float(np.linalg.norm(self.of(changes)))

    def cosines(self, remaining: Floats) -> dict[str, float]:
        """Cosine, 0 … 1, between what is left and its best fit by each effect alone, with allowed signs."""
        length = float(np.linalg.norm(remaining))
        by_name: dict[str, float] = {}
        for index, candidate in enumerate(self.candidates):
            gain, _ = self._explained(index, remaining)
            share = min(1.0, float(np.sqrt(gain)) / length) if length > 0.0 else 0.0
            by_name[candidate.name] = max(share, by_name.get(candidate.name, 0.0))
        return by_name

    def share_of(self, effect: str, remaining: Floats) -> tuple[Candidate, Floats] | None:
        """The shape of an effect that explains most of what is left, and (rows) what it explains; None if
        that is nothing."""
        indices = [index for index, candidate in enumerate(self.candidates) if candidate.name == effect]
        explained = {index: self._explained(index, remaining) for index in indices}
        best = max(indices, key=lambda index: explained[index][0], default=None)
        if best is None or explained[best][0] <= 0.0:
            return None
        return self.candidates[best], explained[best][1]

    def _explained(self, index: int, remaining: Floats) -> tuple[float, Floats]:
        """(squares, rows) explained by one candidate, its signs as physics allows."""
        candidate = self.candidates[index]
        columns = slice(self.starts[index], self.starts[index] + len(candidate.columns))
        matrix = self._signatures[:, columns]
        used = np.flatnonzero(np.any(matrix, axis=0))
        if not used.size:
            return 0.0, np.zeros_like(remaining)
        chosen = matrix[:, used]
        gain, amplitudes = cone(
            (remaining @ chosen)[None, :], chosen.T @ chosen, [candidate.signs[int(k)] for k in used]
        )
        return float(gain[0]), np.asarray(chosen @ amplitudes[0])


def unexplained(linearisation: Linearisation, full_problem: Problem) -> Unexplained:
    """The projection of a linearisation; `full_problem` is the problem from which it was made.

    Raises
    ------
    RigctlError
        the model cannot be simulated there.
    """
    fit = linearisation.fit
    problem = full_problem.only(fit.fitted)
    local = [fit.local[k] for k in fit.fitted]
    slopes = slopes_at(problem, fit, linearisation.nuisances, linearisation.candidates, local)
    # As `linearise`, but in the rows of the readings and not reduced to triangles: changes of readings that
    # are computed later have to be projected by the same bases.
    record_local, nuisance, signatures = [], [], []
    for k, whitener in enumerate(problem.whiteners):
        basis = record_local_rows(problem, k, slopes, local[k], fit.outputs[fit.fitted[k]])[0]
        record_local.append(basis)
        nuisance.append(_off_record_local(whitener(slopes.nuisance[k]), basis))
        signatures.append(_off_record_local(whitener(slopes.signatures[k]), basis))
    weight = linearisation.prior[0]
    shared = _span(np.vstack([*nuisance, weight]))
    stacked = np.vstack([*signatures, np.zeros((weight.shape[0], signatures[0].shape[1]))])
    projected = stacked - shared @ (shared.T @ stacked)
    lengths = np.linalg.norm(projected, axis=0)
    visible = lengths > least_share(fit) * np.where(
        linearisation.full_lengths > 0.0, linearisation.full_lengths, np.inf
    )
    return Unexplained(
        problem=problem,
        candidates=linearisation.candidates,
        starts=linearisation.starts,
        _record_local=tuple(record_local),
        _shared=shared,
        _signatures=np.where(visible, projected / np.where(visible, lengths, 1.0), 0.0),
    )


def _off_record_local(rows: Floats, record_local: Floats) -> Floats:
    """The rows with the record's own unknowns projected off; rows for their priors are appended."""
    padded = np.concatenate([rows, np.zeros((record_local.shape[0] - rows.shape[0], *rows.shape[1:]))])
    return np.asarray(padded - record_local @ (record_local.T @ padded))


def _span(matrix: Floats) -> Floats:
    lengths = np.linalg.norm(matrix, axis=0)
    if not matrix.shape[1]:
        return np.empty((matrix.shape[0], 0))
    left, values, _ = np.linalg.svd(matrix / np.where(lengths > 0.0, lengths, 1.0), full_matrices=False)
    return np.asarray(left[:, values > _RANK * max(float(values[0]), 1e-300)])
