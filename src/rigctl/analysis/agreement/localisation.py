"""Where does the model fail? By condition, phase, channel and state, with p-values.

In: a linearisation. Out: `Place`s, each with its share of the systematic error, and a `CellMap` for the page.
The z-map holds the residual of every record × phase × channel in its standard deviations. A place is looked
at because it is the worst of many, so that its p-value is that of the largest of all cells, which are
correlated through the fitted unknowns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.linear.chi_square import chi2_tail
from rigctl.analysis.linear.linearisation import Linearisation, quiet_columns
from rigctl.analysis.linear.nuisance_projection import Projected
from rigctl.model.fit.errors import whitened_residual
from rigctl.model.fit.fit import FitResult
from rigctl.model.measured.conditions import condition_text, variable_units
from rigctl.units import show

Floats = NDArray[np.float64]

_DRAWS = 4000
#: with more cells than this the largest is judged by Bonferroni's bound instead of simulation
_MOST_DRAWN = 1500
#: a cell that retains less than this share of its variance after the fit is not judged
_LEAST_VARIANCE = 1e-3


@dataclass(frozen=True)
class CellMap:
    """Every cell, and the null distribution of the largest of them.

    Attributes
    ----------
    z: (records, regions) sums of the whitened residuals over a region, in standard deviations; NaN if the
        record has no reading there, or the fit leaves none.
    draws: (draws, cells) simulated values of the cells that are not NaN, in order; empty if there are too
        many.
    noise_degrees: degrees of freedom of the noise, included in the simulation; 0 if the noise counts as
        known.
    """

    z: Floats
    draws: Floats = field(repr=False)
    noise_degrees: int = 0

    @property
    def present(self) -> NDArray[np.bool_]:
        """(records, regions) True where there is a value."""
        return np.isfinite(self.z)

    @cached_property
    def _largest(self) -> Floats:
        """(draws) the largest of all cells."""
        return np.asarray(np.abs(self.draws).max(axis=1))

    def p_value(self, chosen: NDArray[np.bool_]) -> float:
        """Probability that by chance any cell is as large as the largest of the chosen ones.

        Any cell, not only the chosen ones, because these are considered for being the largest of many.
        Parametric bootstrap.
        """
        used = chosen & self.present
        if not used.any():
            return 1.0
        count = int(self.present.sum())
        largest = float(np.abs(self.z[used]).max())
        single = _two_sided(largest)
        bound = 1.0 - (1.0 - single) ** count if single > 1e-12 else count * single
        if not self.draws.size:
            return float(bound)
        drawn = self._largest
        reached = float((drawn >= largest).mean())
        if self.noise_degrees:
            return max(reached, 1.0 / len(drawn))
        return reached if reached * len(drawn) >= 20 else min(float(bound), max(reached, 20.0 / len(drawn)))

    def share(self, chosen: NDArray[np.bool_]) -> float:
        """The chosen cells' share of the systematic error: their ``Σ max(z² − 1, 0)`` over that of all."""
        excess = np.where(self.present, np.maximum(np.nan_to_num(self.z) ** 2 - 1.0, 0.0), 0.0)
        total = float(excess.sum())
        return float(excess[chosen].sum()) / total if total > 0.0 else 0.0


def cell_map(projected: Projected, seed: int = 0) -> CellMap:
    """The cells of a projected linearisation.

    With E_k the regions' unit columns of record k, ``z = E_kᵀr̃ / √diag G`` and their covariance is
    ``G_kl = δ_kl·E_kᵀE_k − (Q_kᵀE_k)ᵀ(Q_lᵀE_l)``, Q the orthonormal basis of the shared unknowns.
    """
    lin = projected.linearisation
    sums, couplings, squares = [], [], []
    row = 0
    for k in projected.records:
        regions = lin.records[k].regions
        rows = slice(row, row + regions.shape[0])
        row = rows.stop
        sums.append(regions.T @ projected.residual[rows])
        couplings.append(projected.basis[rows].T @ regions)
        squares.append(regions.T @ regions)
    # Var(z) before scaling is diag G: less than the number of readings, because the fit has followed some of
    # the noise of each cell. A cell of which it followed nearly everything has nothing to test.
    variance = np.array(
        [np.diag(square) - np.square(c).sum(axis=0) for square, c in zip(squares, couplings, strict=True)]
    )
    present = variance > _LEAST_VARIANCE
    root = np.sqrt(np.where(present, variance, 1.0))
    z = np.where(present, np.array(sums) / root, np.nan)
    # The largest of many correlated cells: its distribution when nothing is wrong is drawn from their
    # covariance.
    draws, degrees = _draws(squares, couplings, present, root, seed), projected.noise_degrees
    if degrees and draws.size:
        generator = np.random.Generator(np.random.PCG64([seed, degrees]))
        draws = draws * np.sqrt(degrees / generator.chisquare(degrees, (draws.shape[0], 1)))
    return CellMap(z, draws, degrees)


def _draws(
    squares: Sequence[Floats],
    couplings: Sequence[Floats],
    present: NDArray[np.bool_],
    root: Floats,
    seed: int,
) -> Floats:
    count = int(present.sum())
    if not 0 < count <= _MOST_DRAWN:
        return np.empty((0, count))
    ends = np.cumsum([0, *present.sum(axis=1)])
    covariance = np.zeros((count, count))
    for k, square in enumerate(squares):
        block = slice(ends[k], ends[k + 1])
        covariance[block, block] = square[np.ix_(present[k], present[k])]
    coupling = np.concatenate([c[:, keep] for c, keep in zip(couplings, present, strict=True)], axis=1)
    covariance -= coupling.T @ coupling
    scale = root[present]
    values, vectors = np.linalg.eigh(covariance / scale[:, None] / scale[None, :])
    normal = np.random.Generator(np.random.PCG64(seed)).standard_normal((_DRAWS, count))
    return np.asarray(normal @ (vectors * np.sqrt(np.maximum(values, 0.0))).T)


def _two_sided(z: float) -> float:
    from math import erfc, sqrt

    return erfc(z / sqrt(2.0))


@dataclass(frozen=True)
class Place:
    """One location of the error.

    Attributes
    ----------
    by: the kind of location.
    label: its name.
    share_of_error: its share of the systematic error.
    rmse: of the normalised residuals there; 1 is the noise.
    p_value: probability of as much at any such location by chance, which holds for the worst of them too.
    """

    by: Literal["condition", "phase", "channel", "state", "cell", "stretch"]
    label: str
    share_of_error: float
    rmse: float
    p_value: float

    def document(self) -> dict[str, Any]:
        """Its machine-readable form."""
        return {
            "by": self.by,
            "label": self.label,
            "share_of_error": self.share_of_error,
            "rmse": self.rmse,
            "p_value": self.p_value,
        }


def localise(linearisation: Linearisation, cells: CellMap) -> tuple[Place, ...]:
    """All locations, those of each kind in order of their share of the error."""
    fit = linearisation.fit
    if fit.problem.measurements.table:  # no phases, each row is a stretch of its own
        places = _conditions(linearisation, cells) + _regions(linearisation, cells, 1)
        return tuple(sorted(places, key=lambda place: (_ORDER[place.by], -place.share_of_error)))
    places = _conditions(linearisation, cells) + _regions(linearisation, cells, 1)
    if len({phase for phase, _ in linearisation.regions.labels}) > 1:  # a single one has all of the error
        places += _regions(linearisation, cells, 0)
    places += _cells(linearisation, cells) + ranges(fit)
    return tuple(sorted(places, key=lambda place: (_ORDER[place.by], -place.share_of_error)))


_ORDER = {"channel": 0, "phase": 1, "cell": 2, "condition": 3, "state": 4, "stretch": 5}


def _rms(values: Floats) -> float:
    present = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(present**2))) if present.size else 0.0


def _conditions(lin: Linearisation, cells: CellMap) -> list[Place]:
    fit, groups = lin.fit, np.array(lin.regions.groups)
    normalised = list(map(fit.normalised_error, fit.fitted))
    units = variable_units(fit.problem.measurements)
    places = []
    names = list(dict.fromkeys(groups.tolist()))
    firsts = [fit.problem.records[fit.fitted[int(np.argmax(groups == group))]] for group in names]
    labels = _distinct(
        [condition_text(one.condition, units) for one in firsts], [one.label for one in firsts]
    )
    for group, label in zip(names, labels, strict=True):
        chosen = np.zeros(cells.z.shape, dtype=bool)
        chosen[groups == group] = True
        members = [k for k in range(len(groups)) if groups[k] == group]
        values = np.concatenate([normalised[k].ravel() for k in members])
        places.append(Place("condition", label, cells.share(chosen), _rms(values), cells.p_value(chosen)))
    return places


def _distinct(conditions: Sequence[str], records: Sequence[str]) -> list[str]:
    """The text of each condition, with its first record where another condition has the same text: records
    may also differ in commands that no condition states."""
    return [
        record if not text else f"{text} ({record})" if conditions.count(text) > 1 else text
        for text, record in zip(conditions, records, strict=True)
    ]


def _regions(lin: Linearisation, cells: CellMap, part: int) -> list[Place]:
    """By phase (part 0) or by channel (part 1)."""
    kind: Literal["phase", "channel"] = "channel" if part else "phase"
    names = dict.fromkeys(label[part] for label in lin.regions.labels)
    places = []
    for name in names:
        columns = np.array([label[part] == name for label in lin.regions.labels])
        chosen = np.zeros(cells.z.shape, dtype=bool)
        chosen[:, columns] = True
        rmse = _rms(_of_region(lin, name if part == 0 else None, name if part else None))
        places.append(Place(kind, name, cells.share(chosen), rmse, cells.p_value(chosen)))
    return places


def _of_region(lin: Linearisation, phase: str | None, channel: str | None) -> Floats:
    fit = lin.fit
    outputs = fit.problem.measurements.outputs
    columns = [k for k, name in enumerate(outputs) if channel in (None, name)]
    pieces = []
    for k in fit.fitted:
        values = fit.normalised_error(k)
        record = fit.problem.records[k]
        names = np.array(record.phases, dtype=object)[record.phase]
        rows = np.ones(record.times.size, bool) if phase in (None, "all") else names == phase
        pieces.append(values[rows][:, columns].ravel())
    return np.concatenate(pieces) if pieces else np.empty(0)


def _cells(lin: Linearisation, cells: CellMap) -> list[Place]:
    """Phase × channel."""
    places = []
    for column, (phase, channel) in enumerate(lin.regions.labels):
        chosen = np.zeros(cells.z.shape, dtype=bool)
        chosen[:, column] = True
        if (chosen & cells.present).any():
            rmse = _rms(_of_region(lin, phase, channel))
            label = channel if phase == "all" else f"{channel} in {phase}"
            places.append(Place("cell", label, cells.share(chosen), rmse, cells.p_value(chosen)))
    return places


def ranges(fit: FitResult) -> list[Place]:
    """Each channel's error in thirds of the channel's own range."""
    places = []
    normalised = list(map(fit.normalised_error, fit.fitted))
    measured = [fit.problem.records[k].values for k in fit.fitted]
    white = [whitened_errors(fit, k) for k in fit.fitted]
    total = sum(float(np.nansum(values**2)) for values in normalised) or 1.0
    for column, name in enumerate(fit.problem.measurements.outputs):
        error, value, whitened = (
            np.concatenate([values[:, column] for values in part]) for part in (normalised, measured, white)
        )
        good = np.isfinite(error) & np.isfinite(value)
        error, value, whitened = error[good], value[good], whitened[good]
        if value.size < 3 or np.ptp(value) == 0.0:
            continue
        edges = np.linspace(value.min(), value.max(), 4)
        unit = fit.problem.measurements.units[column]
        for low, high in pairwise(edges.tolist()):
            inside = (value >= low) & (value <= high)
            if inside.any():
                share = float(np.sum(error[inside] ** 2)) / total
                label = f"{name} {show(float(low), unit, digits=3)} to {show(float(high), unit, digits=3)}"
                chance = _chance(fit, column, whitened[inside])
                places.append(Place("state", label, share, _rms(error[inside]), chance))
    return _worst_of(places)


def worst_stretches(fit: FitResult, count: int = 5) -> tuple[Place, ...]:
    """The stretches (one phase of one channel in one record) with the largest normalised error; none for a
    table."""
    if fit.problem.measurements.table:
        return ()
    normalised = {k: fit.normalised_error(k) for k in fit.fitted}
    total = sum(float(np.nansum(values**2)) for values in normalised.values()) or 1.0
    sizes = []
    for k, values in normalised.items():
        present = np.isfinite(values)
        for p, samples in enumerate(fit.problem.records[k].samples_of_phases):
            for c in range(values.shape[1]):
                inside = samples[present[samples, c]]
                if inside.size:
                    sizes.append((_rms(values[inside, c]), k, p, c, inside))
    places = []
    for size, k, p, c, inside in sorted(sizes, key=lambda one: -one[0])[:count]:
        record = fit.problem.records[k]
        label = f"{fit.problem.measurements.outputs[c]} in {record.phases[p]} of {record.label}"
        share = float(np.sum(normalised[k][inside, c] ** 2)) / total
        chance = _chance(fit, c, whitened_errors(fit, k)[inside, c])
        places.append(Place("stretch", label, share, size, chance))
    return tuple(_worst_of(places, examined=len(sizes)))


def whitened_errors(fit: FitResult, k: int) -> Floats:
    """(n, channels) residuals of a record that are standard normal for pure noise; NaN where none counts.

    The common quantisation error of a coarsely quantised channel at rest, columns Q of unit size, is noise
    too: ``(I + QQᵀ)^(−1/2)·W(f − y)``.
    """
    problem, outputs = fit.problem, fit.outputs[k]
    whitener = problem.whiteners[k]
    rows = whitened_residual(problem, outputs, k)
    quiet = quiet_columns(problem, k, outputs)
    if quiet is not None:
        left, values, _ = np.linalg.svd(whitener(quiet), full_matrices=False)
        rows = rows - left @ ((1.0 - 1.0 / np.sqrt(1.0 + values**2)) * (left.T @ rows))
    errors = np.full(problem.ok[k].shape, np.nan)
    errors[whitener.rows[:, 0], whitener.rows[:, 1]] = rows
    return errors


def _chance(fit: FitResult, column: int, white: Floats) -> float:
    """Probability that noise alone makes the whitened residuals of one channel so large."""
    known = fit.problem.noise.channels[column].degrees
    return chi2_tail(float(np.sum(white**2)), white.size, known)


def _worst_of(places: list[Place], examined: int | None = None) -> list[Place]:
    """With Bonferroni's bound for the number of locations examined, by default these."""
    count = len(places) if examined is None else examined
    return [replace(place, p_value=min(1.0, count * place.p_value)) for place in places]
