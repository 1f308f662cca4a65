"""Which equation lacks a term? Evidence for an unknown disturbance at each slot of the model.

A disturbance w(t) at a slot is mapped through the model's derivatives to the readings, with the fitted
unknowns integrated out. Its prior is smooth in time; between records it is the sum of a smooth function of
the operating point and a record-level part. Readings are slots too: otherwise the fault of a sensor would be
attributed to an equation. The idea is that of Kristensen, Madsen & Jorgensen, Automatica 40 (2004) 225.

All computations use normal matrices from which each record's own unknowns have been projected off.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.agreement.slot_disturbance import (
    ColumnGroup,
    DisturbanceColumns,
    Disturbed,
    disturbance_columns,
    disturbed,
)
from rigctl.analysis.decision_levels import SLOT_LINEAR, SLOT_SEPARABLE
from rigctl.analysis.linear.linearisation import free_unknowns, record_local_rows
from rigctl.analysis.linear.marginal_likelihood import Component, Evidence, Normal, evidence
from rigctl.analysis.linear.regions import make_regions
from rigctl.analysis.linear.slopes import Slopes, slopes_at
from rigctl.effects.registry import library
from rigctl.engine.compile import Progress
from rigctl.engine.least_squares.unknown import prior_rows
from rigctl.engine.one_thread import one_thread
from rigctl.engine.result_cache import cached
from rigctl.engine.threads import in_threads
from rigctl.errors import RigctlError
from rigctl.model.fit.fit import FitResult
from rigctl.model.fit.problem import Problem
from rigctl.physics.family import Slot

Floats = NDArray[np.float64]

#: added to the diagonal of the unknowns' scaled matrix, which may be singular
_RIDGE = 1e-10


@dataclass(frozen=True)
class DisturbanceNormals:
    """Normal matrices of B, the disturbances' whitened columns, J, the fitted unknowns', and the residual r.

    Attributes
    ----------
    square: (records, columns, columns) BᵀB.
    cross: (records, columns, unknowns) BᵀJ.
    gradient: (records, columns) Bᵀr.
    unknowns: JᵀJ, Jᵀr and rᵀr over all records, with the unknowns' priors.
    excess: χ² less what the noise alone would give.
    """

    square: Floats = field(repr=False)
    cross: Floats = field(repr=False)
    gradient: Floats = field(repr=False)
    unknowns: Normal
    excess: float


def disturbance_normals(fit: FitResult, problem: Problem, columns: DisturbanceColumns) -> DisturbanceNormals:
    """The matrices of the records of `problem`, the fitted ones of `fit`, for the unknowns the fit could
    move.

    Raises
    ------
    RigctlError
        a derivative is not a finite number.
    """
    shared = free_unknowns(fit)
    indices = {unknown.name: index for index, unknown in enumerate(fit.problem.shared)}
    local = [fit.local[k] for k in fit.fitted]
    slopes = slopes_at(problem, fit, [unknown.name for unknown in shared], (), local)
    each = in_threads(
        lambda k: _record_normals(fit, problem, columns, slopes, local[k], k), range(len(problem.records))
    )
    prior, weight = prior_rows(shared, fit.values[[indices[unknown.name] for unknown in shared]])
    matrices, dof = np.array([matrix for matrix, _ in each]), sum(count for _, count in each)
    return _split(matrices, columns.readings[0].shape[2], prior, weight, dof)


def _record_normals(
    fit: FitResult, problem: Problem, columns: DisturbanceColumns, slopes: Slopes, local: Floats, k: int
) -> tuple[Floats, int]:
    """The matrix of the record at `k` with its own unknowns projected off, and its degrees of freedom."""
    whitener, ok, outputs = problem.whiteners[k], problem.ok[k], fit.outputs[fit.fitted[k]]
    record = problem.records[k]
    residual = whitener(np.where(ok, np.where(ok, record.values, 0.0) - outputs, 0.0))
    white = whitener(np.concatenate([columns.readings[k], slopes.nuisance[k]], axis=2))
    if not np.isfinite(white).all():
        raise RigctlError(f"record {record.label}: a sensitivity is not a finite number")
    rows = np.column_stack([white, residual])
    matrix = rows.T @ rows
    record_local, weight, prior = record_local_rows(problem, k, slopes, local, outputs)
    absorbed = record_local[: whitener.size].T @ rows
    if weight.size:
        absorbed[:, -1] -= record_local[whitener.size :].T @ prior
        matrix[-1, -1] += prior @ prior
    return matrix - absorbed.T @ absorbed, whitener.size + int((weight > 0.0).sum()) - record_local.shape[1]


def _split(matrices: Floats, count: int, prior: Floats, weight: Floats, dof: int) -> DisturbanceNormals:
    """The blocks of the records' matrices; unknowns are scaled to columns of unit length."""
    total = matrices.sum(axis=0)
    matrix = total[count:-1, count:-1] + np.diag(weight**2)
    gradient = total[count:-1, -1] - weight * prior
    lengths = np.sqrt(np.maximum(np.diag(matrix), 0.0))  # rounding may make it negative
    scale = np.where(lengths > 0.0, 1.0 / np.where(lengths > 0.0, lengths, 1.0), 0.0)
    matrix = matrix * np.outer(scale, scale) + _RIDGE * np.eye(scale.size)
    gradient = gradient * scale
    square = float(total[-1, -1] + prior @ prior)
    absorbed = float(gradient @ np.linalg.solve(matrix, gradient)) if scale.size else 0.0
    dof += int((weight > 0.0).sum()) - scale.size
    return DisturbanceNormals(
        square=matrices[:, :count, :count],
        cross=matrices[:, :count, count:-1] * scale,
        gradient=matrices[:, :count, -1],
        unknowns=Normal(matrix, gradient, square),
        excess=square - absorbed - dof,
    )


#: knots over a record; the larger number if few records leave room for it
_KNOTS, _MORE_KNOTS, _FEW_RECORDS = 11, 24, 3
#: of more records, or longer ones, a subset is enough to rank equations
_MOST_RECORDS, _MOST_SAMPLES = 32, 2000
#: correlation length of a disturbance, in knots
_MEMORY = 3.0
#: number of smooth functions of the operating point
_FEATURES = 6


@dataclass(frozen=True)
class SlotEvidence:
    """The evidence that a term is missing at a slot.

    Attributes
    ----------
    slot: its name; several, joined by " + ", if one effect of the library acts at all of them.
    meaning: description of the slot.
    log_evidence: for a disturbance there, relative to none; negative if the data do not need one.
    share: of the misfit that a disturbance explains, 0 to 1.
    when: the phase in which the disturbance is largest.
    alike: the slots that these data do not distinguish from it, by decreasing evidence.
    """

    slot: str
    meaning: str
    log_evidence: float
    share: float
    when: str
    alike: tuple[str, ...] = ()

    def document(self) -> dict[str, Any]:
        """Its machine-readable form."""
        return {
            "slot": self.slot,
            "meaning": self.meaning,
            "log_evidence": self.log_evidence,
            "share_of_error": self.share,
            "when": self.when,
            "alike": list(self.alike),
        }


@one_thread()
def slot_evidence(fit: FitResult, *, progress: Progress | None = None) -> tuple[SlotEvidence, ...]:
    """The slots at which a disturbance is visible in the measured readings, by decreasing evidence.

    Of very many fitted records, and of long ones, a subset is used.

    Raises
    ------
    RigctlError
        the model cannot be simulated or differentiated at the fit.
    """
    if not fit.problem.model.family.slots:  # no location for a term
        return ()
    # A subset suffices to rank slots, and keeps the cost independent of the size of a campaign.
    fit = some_records(fit)
    problem = fit.problem
    knots = _MORE_KNOTS if len(problem.records) <= _FEW_RECORDS else _KNOTS
    model = disturbed(problem, knots, progress)
    at = (problem.content, fit.values, fit.local, fit.outputs, free_unknowns(fit))
    model_key = (model.compiled.source.text, model.moving, model.reading, knots, _together(problem))
    ranking = cached("slots", (at, model_key), _Ranking, lambda: _Ranking(_evidence(fit, problem, model)))
    return ranking.slots


@dataclass(frozen=True)
class _Ranking:
    """The result that is kept between commands."""

    slots: tuple[SlotEvidence, ...]


def _evidence(fit: FitResult, problem: Problem, model: Disturbed) -> tuple[SlotEvidence, ...]:
    # 1. Unit disturbances at every knot of every slot, as changes of the readings.
    columns = disturbance_columns(fit, problem, model)
    # 2. BᵀB, BᵀJ, Bᵀr in whitened rows, each record's own unknowns projected off: small, however
    #    many samples there are.
    normals = disturbance_normals(fit, problem, columns)
    # 3. The prior over records: a part that is smooth in the operating point, and one of each record alone.
    features = _features(make_regions(problem).conditions)

    def found(parts: tuple[ColumnGroup, ...]) -> _Found | None:
        component, root = _component(normals, parts)
        if component is None:
            return None
        best = evidence(component, normals.unknowns, features)
        return _Found(parts, best, best.amplitudes @ root.T)

    each = in_threads(found, list(_hypotheses(problem, columns.parts)))
    tests = [one for one in each if one is not None]
    return _ranked(_one_each(tests), problem, columns, normals.excess)


def some_records(fit: FitResult, *, samples: int = _MOST_SAMPLES) -> FitResult:
    """The fitted records; a fixed random subset of many, and equally spaced samples of long ones."""
    indices = np.array(fit.fitted)
    if indices.size > _MOST_RECORDS:
        draw = np.random.Generator(np.random.PCG64(0))
        indices = np.sort(draw.choice(indices, _MOST_RECORDS, replace=False))
    chosen = [
        np.arange(0, count, -(-count // samples), dtype=np.intp)
        for count in (fit.problem.records[index].times.size for index in indices)
    ]
    return replace(
        fit,
        problem=fit.problem.only(indices.tolist()).at_samples(chosen),
        fitted=tuple(range(indices.size)),
        local=tuple(fit.local[index] for index in indices),
        outputs=tuple(fit.outputs[index][at] for index, at in zip(indices, chosen, strict=True)),
    )


@dataclass(frozen=True)
class _Found:
    """A disturbance that was tried; `amplitudes` (records, columns) are in the slots' units."""

    parts: tuple[ColumnGroup, ...]
    evidence: Evidence
    amplitudes: Floats

    @property
    def slots(self) -> tuple[Slot, ...]:
        return tuple(dict.fromkeys(part.slot for part in self.parts))


def _hypotheses(problem: Problem, parts: Sequence[ColumnGroup]) -> Iterator[tuple[ColumnGroup, ...]]:
    """The hypotheses: each slot, a reading in two ways, and the slots together at which one effect acts."""
    by_slot: dict[str, list[ColumnGroup]] = {}
    for part in parts:
        by_slot.setdefault(part.slot.name, []).append(part)
    for parts_of in by_slot.values():
        constant = tuple(part for part in parts_of if part.view != "time")
        if constant and len(constant) < len(parts_of):
            yield constant
        yield tuple(parts_of)
    for slots in _together(problem):
        if all(len(by_slot.get(slot, ())) == 1 for slot in slots):
            yield tuple(by_slot[slot][0] for slot in slots)


def _together(problem: Problem) -> list[tuple[str, ...]]:
    """The groups of slots at which a single effect of the library acts."""
    model = problem.model
    effects = [*library(model.family).values(), *model.own_effects]
    slots = {effect.slots for effect in effects if effect.name not in model.effects}
    return [together for together in sorted(slots) if len(together) > 1]


def _component(normals: DisturbanceNormals, parts: Sequence[ColumnGroup]) -> tuple[Component | None, Floats]:
    """The normal matrices of a component, each part scaled to the same trace, and the root of its prior
    covariance.

    None if no reading shows it.
    """
    indices = np.concatenate([np.arange(part.columns.start, part.columns.stop) for part in parts])
    square = normals.square[:, indices[:, None], indices[None, :]]
    total = square.sum(axis=0)
    root = np.zeros((indices.size, indices.size))
    first = 0
    for part in parts:
        last = first + part.columns.stop - part.columns.start
        block = slice(first, last)
        prior = _prior_root(np.diag(total)[block], part.knots)
        trace = float(np.trace(prior.T @ total[block, block] @ prior))
        if trace > 0.0 and np.isfinite(trace):
            root[block, block] = prior / np.sqrt(len(parts) * trace)
        first = last
    if not root.any():
        return None, root
    return (
        Component(
            root.T @ square @ root,
            root.T @ normals.cross[:, indices],
            normals.gradient[:, indices] @ root,
        ),
        root,
    )


def _prior_root(lengths: Floats, knots: int) -> Floats:
    """Root of ``exp(−|i − j|/memory)`` over each run of knots; columns without an order are weighted
    equally."""
    if not knots:
        return np.diag(np.where(lengths > 0.0, 1.0 / np.sqrt(np.where(lengths > 0.0, lengths, 1.0)), 0.0))
    distance = np.abs(np.subtract.outer(np.arange(knots), np.arange(knots)))
    block = np.linalg.cholesky(np.exp(-distance / _MEMORY))
    return np.asarray(np.kron(np.eye(lengths.size // knots), block))


def _features(conditions: Floats) -> Floats:
    """(records, features) whose products approximate ``1 + c·c′ + 0.3·exp(−|c − c′|²/2)``.

    For a single record there are none: its disturbance is entirely record-level.
    """
    if conditions.shape[0] < 2:
        return np.empty((conditions.shape[0], 0))
    squared_distances = np.square(conditions[:, None, :] - conditions[None, :, :]).sum(axis=2)
    values, vectors = np.linalg.eigh(1.0 + conditions @ conditions.T + 0.3 * np.exp(-0.5 * squared_distances))
    indices = np.argsort(-values)[:_FEATURES]
    indices = indices[values[indices] > 1e-9 * values[indices[0]]]
    return np.asarray(vectors[:, indices] * np.sqrt(values[indices]))


def _one_each(tests: Sequence[_Found]) -> list[_Found]:
    """For each slot tried by several hypotheses, the best one with the mean evidence of all."""
    ways: dict[tuple[Slot, ...], list[_Found]] = {}
    for one in tests:
        ways.setdefault(one.slots, []).append(one)
    result = []
    for tried in ways.values():
        logs = np.array([one.evidence.log_evidence for one in tried])
        best = tried[int(np.argmax(logs))]
        mean = float(logs.max() + np.log(np.mean(np.exp(logs - logs.max()))))
        result.append(replace(best, evidence=replace(best.evidence, log_evidence=mean)))
    return result


def _ranked(
    tests: Sequence[_Found], problem: Problem, columns: DisturbanceColumns, excess: float
) -> tuple[SlotEvidence, ...]:
    ordered = sorted(tests, key=lambda one: -one.evidence.log_evidence)
    misfit = max([excess, *(one.evidence.explained for one in ordered), 1.0])
    names = [" + ".join(slot.name for slot in one.slots) for one in ordered]
    logs = [one.evidence.log_evidence for one in ordered]
    result = []
    for one, name, log in zip(ordered, names, logs, strict=True):
        near = max(SLOT_SEPARABLE, SLOT_LINEAR * abs(log))
        alike = [
            other
            for other, its in zip(names, logs, strict=True)
            if other != name and abs(its - log) < near and log > SLOT_SEPARABLE
        ]
        share = min(max(one.evidence.explained / misfit, 0.0), 1.0) if log > 0.0 else 0.0
        meaning = "; ".join(slot.meaning for slot in one.slots)
        result.append(SlotEvidence(name, meaning, log, share, _when(one, problem, columns), tuple(alike)))
    return tuple(result)


def _when(test: _Found, problem: Problem, columns: DisturbanceColumns) -> str:
    """The phase with the largest mean square of the disturbance, each slot's relative to its own mean."""
    squares: dict[str, list[float]] = {}
    for slot in test.slots:
        courses = [_course(test, columns.courses[k], slot, k) for k in range(len(problem.records))]
        mean = float(np.mean(np.concatenate(courses) ** 2)) or 1.0
        for record, course in zip(problem.records, courses, strict=True):
            for name, samples in zip(record.phases, record.samples_of_phases, strict=True):
                inside = course[samples]
                if inside.size:
                    squares.setdefault(name, []).append(float(np.mean(inside**2)) / mean)
    return max(squares, key=lambda name: float(np.mean(squares[name])))


def _course(test: _Found, courses: Floats, slot: Slot, k: int) -> Floats:
    """(n) the disturbance at one slot in one record."""
    total = np.zeros(courses.shape[0])
    first = 0
    for part in test.parts:
        width = part.columns.stop - part.columns.start
        if part.slot == slot:
            total += courses[:, part.columns] @ test.amplitudes[k, first : first + width]
        first += width
    return total
