"""Score tests of every candidate effect, at the family-wise level of the whole library.

    z = S̃ᵀr̃ / ‖s̃‖  ~  N(0, C),   C_ij = cos(s̃_i, s̃_j)   when nothing is missing

Rao's score (Lagrange multiplier) test. An effect that physics allows in one direction only is tested in that
direction; one with several parameters by its best point in the cone of allowed signs; one with shape
parameters by the best of a grid of them. The null distribution of the maximum over all is simulated
(R. B. Davies, Biometrika 64 (1977) 247).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.linear.candidates import by_effect
from rigctl.analysis.linear.nuisance_projection import Projected
from rigctl.effects.record_level import RECORD
from rigctl.engine.threads import in_threads

Floats = NDArray[np.float64]

_DRAWS = 20000


@dataclass(frozen=True)
class Score:
    """The test of one effect.

    Attributes
    ----------
    effect: its name.
    candidate: index of its best shape among the linearisation's candidates.
    gain: the reduction of χ² that the linear problem predicts, over the cone of its signs.
    z: square root of `gain`: the size of the effect in the data, in sigmas, by the linear problem.
    p_value: family-wise: probability that the best of all candidates is at least as good by chance.
    amplitudes: (parameters) at the linear problem's minimum, in SI, less their null values.
    kappa: the share of the signature that the fitted unknowns cannot absorb.
    hidden_in: the fitted unknown that absorbs most of it; `record` if record-level nuisance parameters, such
        as a pressure setting or a zero error, absorb most.
    """

    effect: str
    candidate: int
    gain: float
    z: float
    p_value: float
    amplitudes: Floats
    kappa: float
    hidden_in: str


@dataclass(frozen=True)
class Screening:
    """The scores of all candidates, best first, and the effects that these data cannot test."""

    scores: tuple[Score, ...]
    untestable: tuple[str, ...]
    p_value: float
    statistic: float


def screen(projected: Projected, seed: int = 0, null: Floats | None = None) -> Screening:
    """Score every candidate of a linearisation; `null` is its `null_of_best`, if already computed."""
    lin = projected.linearisation
    usable = projected.usable
    tests = _tests(projected)
    testable = {lin.candidates[index].name for index, _ in tests}
    untestable = tuple(name for name in by_effect(lin.candidates) if name not in testable)
    if not tests:
        return Screening((), untestable, 1.0, 0.0)
    # Signatures of unit length: z = s̃ᵀr̃/‖s̃‖ has unit variance for a right model, and two scores are
    # correlated by the cosine of their signatures. `unit` converts amplitudes of unit columns back to SI.
    unit = np.where(usable, 1.0 / np.where(usable, projected.lengths, 1.0), 0.0)
    signatures = projected.signatures * unit
    cosines = signatures.T @ signatures
    z = signatures.T @ projected.residual
    least = null_of_best(projected, seed) if null is None else null
    tested = []
    for index, columns in tests:
        signs = _signs(projected, index, columns)
        gain, amplitudes = cone(z[columns][None, :], cosines[np.ix_(columns, columns)], signs)
        tested.append((index, columns, float(gain[0]), float(tail(gain, signs)[0]), amplitudes[0]))
    scores = [
        _score(
            projected,
            index,
            columns,
            gain,
            _family(p, least, len(tested), drawn=projected.noise_degrees > 0),
            amplitudes * unit[columns],
        )
        for index, columns, gain, p, amplitudes in tested
    ]
    # The shapes of one effect compete as separate tests, and the family-wise p counts all of them: the best
    # one can then be taken without a further correction.
    best = _best_of_each(scores)
    top = max(best, key=lambda score: (-score.p_value, score.gain))
    return Screening(tuple(best), untestable, top.p_value, top.z)


def null_of_best(projected: Projected, seed: int = 0) -> Floats:
    """(draws) the smallest p-value of all candidates when nothing is missing, sorted.

    It depends on the signatures alone, not on the residual.
    """
    usable = projected.usable
    unit = np.where(usable, 1.0 / np.where(usable, projected.lengths, 1.0), 0.0)
    signatures = projected.signatures * unit
    cosines = signatures.T @ signatures
    # z ~ N(0, C) by the square root of C; for a noise of few degrees of freedom one factor √(ν/χ²_ν) for a
    # whole draw, because all scores share the same σ. Every draw goes through the same cones as the data.
    draws = _draws(cosines, seed) * _noise_draws(projected.noise_degrees, seed)
    # among effects with the same distribution of the gain, the largest gain has the smallest p-value
    largest: dict[tuple[int, bool], tuple[Floats, list[int]]] = {}

    def gains(test: tuple[int, NDArray[np.intp]]) -> tuple[Floats, list[int]]:
        index, columns = test
        signs = _signs(projected, index, columns)
        return cone(draws[:, columns], cosines[np.ix_(columns, columns)], signs)[0], signs

    for gain, signs in in_threads(gains, _tests(projected)):
        kind = len(signs), len(signs) == 1 and bool(signs[0])
        largest[kind] = np.maximum(largest[kind][0], gain) if kind in largest else gain, signs
    least = np.ones(len(draws))
    for gain, signs in largest.values():
        np.minimum(least, tail(gain, signs), out=least)
    least.sort()
    return least


def _tests(projected: Projected) -> list[tuple[int, NDArray[np.intp]]]:
    """For each candidate with a visible signature: its index and its usable columns."""
    lin, usable = projected.linearisation, projected.usable
    tests = [
        (index, np.flatnonzero(usable[lin.columns_of(index)]) + lin.starts[index])
        for index in range(len(lin.candidates))
    ]
    return [(index, columns) for index, columns in tests if columns.size]


def cone(z: Floats, cosines: Floats, signs: Sequence[int]) -> tuple[Floats, Floats]:
    """Largest gain ``2θᵀz − θᵀCθ`` over θ with the given signs, and that θ; for each row of z (draws, k).

    The maximum is the unconstrained one over some subset of the parameters, the others being 0; all subsets
    are tried.
    """
    count, k = z.shape
    if k == 1:
        return _half_line(z, float(cosines[0, 0]), signs[0])
    best, amplitudes = np.zeros(count), np.zeros((count, k))
    wanted = np.array(signs)
    for number in range(1, k + 1):
        for subset in combinations(range(k), number):
            chosen = list(subset)
            inverse = np.linalg.pinv(cosines[np.ix_(chosen, chosen)], rcond=1e-10, hermitian=True)
            theta = z[:, chosen] @ inverse
            gain = np.einsum("dk,dk->d", z[:, chosen], theta)
            feasible = np.all((wanted[chosen] == 0) | (theta * wanted[chosen] > 0.0), axis=1)
            better = feasible & (gain > best)
            best = np.where(better, gain, best)
            moved = np.zeros((count, k))
            moved[:, chosen] = theta
            amplitudes = np.where(better[:, None], moved, amplitudes)
    return best, amplitudes


def _half_line(z: Floats, cosine: float, sign: int) -> tuple[Floats, Floats]:
    """`cone` for a single parameter."""
    theta = z * (1.0 / cosine if cosine > 0.0 else 0.0)
    if sign:
        theta = np.where(theta * sign > 0.0, theta, 0.0)
    return z[:, 0] * theta[:, 0], theta


def tail(gain: Floats, signs: Sequence[int]) -> Floats:
    """p-value of a gain for one effect: χ² with its number of parameters, halved for a single one-sided one.

    For several one-sided parameters it is an upper bound; as the family-wise level is simulated, it need not
    be exact.
    """
    from scipy.special import erfc, gammaincc

    half = 0.5 * np.maximum(gain, 0.0)
    chance = erfc(np.sqrt(half)) if len(signs) == 1 else gammaincc(0.5 * len(signs), half)
    if len(signs) == 1 and signs[0]:
        chance = 0.5 * chance
    return np.where(gain > 0.0, chance, 1.0)


def _signs(projected: Projected, index: int, columns: NDArray[np.intp]) -> list[int]:
    lin = projected.linearisation
    return [lin.candidates[index].signs[int(column) - lin.starts[index]] for column in columns]


def _draws(cosines: Floats, seed: int) -> Floats:
    values, vectors = np.linalg.eigh(cosines)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    return np.asarray(_normal(cosines.shape[0], seed) @ root.T)


@lru_cache(maxsize=4)
def _normal(count: int, seed: int) -> Floats:
    return np.random.Generator(np.random.PCG64(seed)).standard_normal((_DRAWS, count))


def _noise_draws(degrees: int, seed: int) -> Floats:
    """(draws, 1) factors that turn normal scores into Student's t with `degrees` degrees of freedom."""
    if not degrees:
        return np.ones((1, 1))
    generator = np.random.Generator(np.random.PCG64([seed, degrees]))
    return np.asarray(np.sqrt(degrees / generator.chisquare(degrees, (_DRAWS, 1))))


def _family(p: float, least: Floats, tests: int, *, drawn: bool = False) -> float:
    """Family-wise p-value: the share of draws whose best p-value is as small; Bonferroni's bound beyond them.

    With `drawn` the bound, which holds for known noise only, is not used.
    """
    reached = float(np.searchsorted(least, p, side="right")) / least.size
    if drawn:
        return max(reached, 1.0 / least.size)
    return reached if reached * least.size >= 20.0 else min(max(reached, 1.0 / least.size), tests * p)


def _score(
    projected: Projected, index: int, columns: NDArray[np.intp], gain: float, p: float, amplitudes: Floats
) -> Score:
    lin = projected.linearisation
    every = np.zeros(len(lin.candidates[index].columns))
    every[columns - lin.starts[index]] = amplitudes
    return Score(
        effect=lin.candidates[index].name,
        candidate=index,
        gain=gain,
        z=float(np.sqrt(max(gain, 0.0))),
        p_value=p,
        amplitudes=every,
        kappa=float(projected.kappa[columns].min()),
        hidden_in=_hidden_in(projected, columns, amplitudes),
    )


def _hidden_in(projected: Projected, columns: NDArray[np.intp], amplitudes: Floats) -> str:
    """The unknown that absorbs most of a signature.

    The record-level unknowns absorb ``1 − κ₁²`` of its square first, the shared ones then ``κ₁² − κ²``.
    """
    least = columns[int(np.argmin(projected.kappa[columns]))]
    after_all, after_local = projected.kappa[least] ** 2, projected.after_record_local[least] ** 2
    if 1.0 - after_local > after_local - after_all:
        return RECORD
    lin = projected.linearisation
    if not lin.nuisances:
        return ""
    moves = projected.coefficients[:, columns] @ (amplitudes if np.any(amplitudes) else np.ones(columns.size))
    size_of = {unknown.name: unknown.size for unknown in lin.fit.problem.shared}
    scale = np.array([size_of.get(name, 1.0) for name in lin.nuisances])  # for a shape, that of its prior
    return lin.nuisances[int(np.argmax(np.abs(moves) / scale))]


def _best_of_each(scores: Sequence[Score]) -> list[Score]:
    """One score for each effect, that of its best shape; smallest p-value first."""
    best: dict[str, Score] = {}
    for score in scores:
        held = best.get(score.effect)
        if held is None or score.gain > held.gain:
            best[score.effect] = score
    return sorted(best.values(), key=lambda score: (score.p_value, -score.gain))
