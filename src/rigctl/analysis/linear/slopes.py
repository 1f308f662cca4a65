"""Derivatives of the readings of a fitted model: by its unknowns, and by candidates at their null or size.

In: a fit, and its data with the equations of the whole library. Out: `Slopes`, not whitened, SI. An effect
that is off has an exact derivative, integrated with the states; one with a threshold has none, and its column
is a secant. Simulations are what a linearisation costs, so that as many columns as possible share one.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.linear.candidates import Candidate
from rigctl.model.fit.fit import FitResult
from rigctl.model.fit.problem import Problem

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Slopes:
    """(n, channels, columns) for each record: nuisances, candidates' columns, and own unknowns by name."""

    nuisance: list[Floats]
    signatures: list[Floats]
    record_local: list[Mapping[str, Floats]]

    def of(self, indices: Sequence[int]) -> Slopes:
        """The slopes of the records at `indices`, in new lists."""
        return Slopes(
            nuisance=[self.nuisance[k] for k in indices],
            signatures=[self.signatures[k] for k in indices],
            record_local=[self.record_local[k] for k in indices],
        )


class KnownSlopes:
    """The derivatives of one linearisation, for another at the same point with further columns.

    They are large: kept only if those of all records fit into memory together, and until used once.
    """

    def __init__(self) -> None:
        self._found: tuple[object, Slopes] | None = None

    def keep(self, point: object, slopes: Slopes) -> None:
        """Keep what was computed at a point, by the same unknowns and candidates."""
        self._found = point, slopes

    def take(self, point: object) -> Slopes | None:
        """Return and forget the slopes kept for `point`; None if they are of another point."""
        if self._found is None or self._found[0] != point:
            return None
        (_, slopes), self._found = self._found, None
        return slopes


def slopes_at(
    problem: Problem,
    fit: FitResult,
    free: Sequence[str],
    chosen: Sequence[Candidate],
    local: Sequence[Floats],
) -> Slopes:
    """Derivatives of the records of `problem` at `fit`, by the unknowns `free`, the candidates and their own.

    Simulates once with every column, and once more for each further choice of shapes and each finite size.
    """
    base = base_at(problem, fit)
    # 1. One simulation has the derivatives by everything that can be had at the same parameter values:
    #    unknowns, and effects in their usual shape, or in the first of their grid if they are off.
    first = _shaped_first(fit, chosen)
    at = problem.with_shared((), _with_shapes(problem, base, [chosen[index] for index in first]))
    plain = [
        name
        for index, one in enumerate(chosen)
        if index in first or not (one.shapes or one.secants)
        for name in one.columns
    ]
    columns = tuple(dict.fromkeys([*free, *problem.local_names, *plain]))
    simulated = at.simulate(np.empty(0), local, columns, initial=True).require()
    index = {name: k for k, name in enumerate(simulated.columns)}
    every = [np.take(array, problem.channels, axis=1) for array in simulated.sensitivities]
    # 2. Other shapes, and secants at finite sizes, need simulations of their own.
    further = {k: one for k, one in enumerate(chosen) if one.shapes and k not in first}
    elsewhere = _shaped(at, base, further, local) | _sized(at, base, chosen, local, simulated.outputs)
    # 3. All are put together in the order of the candidates.
    starts = np.cumsum([0, *(len(one.columns) for one in chosen)])
    direct = [k for k in range(len(chosen)) if k not in elsewhere]
    into = [column for k in direct for column in range(starts[k], starts[k + 1])]
    out_of = [index[name] for k in direct for name in chosen[k].columns]
    signatures = [np.empty((*array.shape[:2], starts[-1])) for array in every]
    for k, (signature, array) in enumerate(zip(signatures, every, strict=True)):
        signature[:, :, into] = array[:, :, out_of]
        for position, arrays in elsewhere.items():
            signature[:, :, starts[position] : starts[position + 1]] = arrays[k]
    return Slopes(
        nuisance=[array[:, :, [index[name] for name in free]] for array in every],
        signatures=signatures,
        record_local=[{name: array[:, :, k] for name, k in index.items()} for array in every],
    )


def base_at(problem: Problem, fit: FitResult) -> Floats:
    """The superset's parameters at the fitted point; those that the fitted system lacks are at their null."""
    indices = {name: k for k, name in enumerate(problem.compiled.system.parameter_names)}
    base = problem.base.copy()
    for name, value in zip(fit.problem.compiled.system.parameter_names, fit.problem.base, strict=True):
        if name in indices:
            base[indices[name]] = value
    for unknown, value in zip(fit.problem.shared, fit.values, strict=True):
        base[indices[unknown.name]] = value
    return base


def _shaped_first(fit: FitResult, chosen: Sequence[Candidate]) -> frozenset[int]:
    """The indices of candidates whose shapes the simulation with every column can have.

    At its null an effect acts on nothing, whatever its shape: of each that the fit does not have, and that is
    not looked at in its usual shape, the first.
    """
    present = set(fit.problem.model.effects) | {one.name for one in chosen if not one.shapes or one.secants}
    indices = []
    for index, one in enumerate(chosen):
        if one.name not in present:
            present.add(one.name)
            indices.append(index)
    return frozenset(indices)


def _with_shapes(problem: Problem, base: Floats, together: Collection[Candidate]) -> Floats:
    """The parameters `base` with the shapes of some candidates."""
    names = problem.compiled.system.parameter_names
    moved = base.copy()
    for one in together:
        for name, value in one.shapes.items():
            moved[names.index(name)] = value
    return moved


def _shaped(
    problem: Problem, base: Floats, further: Mapping[int, Candidate], local: Sequence[Floats]
) -> dict[int, list[Floats]]:
    """Columns at other shapes; candidates of different effects share a simulation."""
    rounds: list[dict[int, Candidate]] = []
    for index, one in further.items():
        home = next((r for r in rounds if all(other.name != one.name for other in r.values())), None)
        if home is None:
            home = {}
            rounds.append(home)
        home[index] = one
    result: dict[int, list[Floats]] = {}
    for together in rounds:
        moved = _with_shapes(problem, base, together.values())
        columns = [name for one in together.values() for name in one.columns]
        simulated = problem.with_shared((), moved).simulate(np.empty(0), local, columns).require()
        for index, one in together.items():
            at = [columns.index(name) for name in one.columns]
            result[index] = [np.take(s, problem.channels, axis=1)[:, :, at] for s in simulated.sensitivities]
    return result


def _sized(
    problem: Problem,
    base: Floats,
    chosen: Sequence[Candidate],
    local: Sequence[Floats],
    outputs: Sequence[Floats],
) -> dict[int, list[Floats]]:
    """For the candidates evaluated at a size a: the secant ``(f(a) − f(φ))/(a − φ)`` instead of the slope.

    `outputs` are the outputs f(φ) at the point itself, where the effect is off or has its fitted size.
    """
    names = problem.compiled.system.parameter_names
    result: dict[int, list[Floats]] = {}
    for index, one in enumerate(chosen):
        if not one.secants:
            continue
        moved = base.copy()
        for name, value in one.secants.items():
            moved[names.index(name)] = value
        rest = [name for name in one.columns if name not in one.secants]
        simulated = problem.with_shared((), moved).simulate(np.empty(0), local, rest).require()
        steps = {name: value - base[names.index(name)] for name, value in one.secants.items()}
        result[index] = []
        for k, output in enumerate(outputs):
            columns = {name: simulated.sensitivities[k][:, :, i] for i, name in enumerate(rest)}
            for name, step in steps.items():
                columns[name] = (simulated.outputs[k] - output) / step if step else np.zeros_like(output)
            readings = [np.take(columns[name], problem.channels, axis=1) for name in one.columns]
            result[index].append(np.stack(readings, axis=2))
    return result
