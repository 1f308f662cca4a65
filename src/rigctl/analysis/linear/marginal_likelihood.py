"""Evidence for a component of variance, with the fitted unknowns integrated out.

    r = J·θ + B·a + e,   e ~ N(0, 1),   a_c = Σ_f φ_f(c)·α_f + δ_c,   α ~ N(0, v), δ ~ N(0, u)

c is the index of the record. The log-likelihood of r relative to u = v = 0, with a flat prior for θ unless
one is given, is averaged over a grid of u and v. It is a restricted likelihood, computed by Woodbury's
identity on normal matrices, so that its cost does not depend on the number of samples.

Source: Patterson & Thompson, Biometrika 58 (1971) 545; Rasmussen & Williams, Gaussian Processes for Machine
Learning (2006), chapters 2 and 5.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

#: grids of the component's size λ in the data, in sigmas, for u and for v
_OWN = (0.0, 8.0, 64.0, 512.0, 4096.0)
_SHARED = (0.0, 4.0, 16.0, 64.0, 256.0, 1024.0, 4096.0, 16384.0)


@dataclass(frozen=True)
class Normal:
    """Normal matrices of the fitted unknowns, over all records, with their priors.

    Attributes
    ----------
    matrix: (unknowns, unknowns) JᵀJ; gradient: (unknowns) Jᵀr; square: rᵀr.
    """

    matrix: Floats
    gradient: Floats
    square: float


@dataclass(frozen=True)
class Component:
    """Normal matrices of one component in each record; its columns are scaled so that ΣBᵀB has trace 1.

    Attributes
    ----------
    square: (records, k, k) BᵀB; cross: (records, k, unknowns) BᵀJ; gradient: (records, k) Bᵀr.
    """

    square: Floats
    cross: Floats
    gradient: Floats


@dataclass(frozen=True)
class Evidence:
    """The answer of `evidence`.

    log_evidence: logarithm of the mean likelihood over the grid, relative to no component.
    explained: reduction of χ² at the most likely u and v.
    amplitudes: (records, k) posterior mean of a at these.
    """

    log_evidence: float
    explained: float
    amplitudes: Floats = field(repr=False)


@dataclass(frozen=True)
class _RecordLocal:
    """The problem with δ integrated out at one u, in terms of θ and α."""

    log_likelihood: float
    theta: Floats
    alpha: Floats
    cross: Floats
    gradient: tuple[Floats, Floats]
    weight: Floats


def evidence(component: Component, normal: Normal, features: Floats) -> Evidence:
    """Evidence of a component; `features` (records, f) are φ, with f = 0 if only δ is estimated."""
    # In the eigenvectors of BᵀB of each record the part of that record alone is diagonal: integrating it out
    # is a weight u/(1 + u·λ) for each direction, at any u of the grid.
    values, vectors = np.linalg.eigh(component.square)
    values = np.maximum(values, 0.0)
    rotated = Component(
        np.swapaxes(vectors, 1, 2) @ component.square,
        np.einsum("cki,ckp->cip", vectors, component.cross, optimize=True),
        np.einsum("cki,ck->ci", vectors, component.gradient),
    )
    # Relative to the model without a component: θ is integrated out on both sides (restricted likelihood), so
    # that components that the fitted unknowns can imitate gain nothing.
    nothing = _restricted(normal.matrix, normal.gradient)
    squares: list[tuple[float, float, float]] = []
    for strength in _OWN:
        record_local = _without_record_local(component, rotated, normal, values, features, strength**2)
        shared = _shared(record_local, features)
        squares += [(gain - nothing, strength**2, square) for gain, square in shared]
    likelihoods = np.array([one[0] for one in squares])
    top = int(np.argmax(likelihoods))
    # The mean over the grid of (u, v), not the maximum: a component does not win by having its size tuned.
    mean = likelihoods[top] + np.log(np.mean(np.exp(likelihoods - likelihoods[top])))
    _, u, v = squares[top]
    record_local = _without_record_local(component, rotated, normal, values, features, u)
    amplitudes = _amplitudes(component, rotated, vectors, record_local, features, v)
    return Evidence(float(mean), _explained(component, normal, amplitudes), amplitudes)


def _restricted(matrix: Floats, gradient: Floats) -> float:
    """``½·gᵀM⁻¹g − ½·ln|M|``."""
    if not gradient.size:
        return 0.0
    _, log_determinant = np.linalg.slogdet(matrix)
    return 0.5 * float(gradient @ np.linalg.solve(matrix, gradient)) - 0.5 * float(log_determinant)


def _without_record_local(
    component: Component, rotated: Component, normal: Normal, values: Floats, features: Floats, u: float
) -> _RecordLocal:
    weight = u / (1.0 + u * values)
    weighted = rotated.cross * weight[:, :, None]
    theta = normal.matrix - np.einsum("cip,ciq->pq", rotated.cross, weighted, optimize=True)
    slope = normal.gradient - np.einsum("cip,ci->p", weighted, rotated.gradient)
    gain = 0.5 * float((weight * rotated.gradient**2).sum()) - 0.5 * float(np.log1p(u * values).sum())
    count, f = features.shape
    k = values.shape[1]
    back = np.swapaxes(rotated.square * weight[:, :, None], 1, 2)
    square = component.square - back @ rotated.square
    cross = component.cross - back @ rotated.cross
    gradient = component.gradient - np.einsum("cik,ck->ci", back, rotated.gradient)
    pairs = (features[:, :, None] * features[:, None, :]).reshape(count, f * f)
    alpha = (pairs.T @ square.reshape(count, k * k)).reshape(f, f, k, k)
    return _RecordLocal(
        log_likelihood=gain + _restricted(theta, slope),
        theta=theta,
        alpha=np.asarray(alpha.transpose(0, 2, 1, 3).reshape(f * k, f * k)),
        cross=np.einsum("cf,ckp->fkp", features, cross, optimize=True).reshape(f * k, slope.size),
        gradient=(slope, (features.T @ gradient).reshape(f * k)),
        weight=weight,
    )


def _projected(record_local: _RecordLocal) -> tuple[Floats, Floats]:
    """Normal matrix and gradient of α with θ projected off."""
    slope, gradient = record_local.gradient
    if not slope.size:
        return record_local.alpha, gradient
    solved = np.linalg.solve(record_local.theta, np.column_stack([record_local.cross.T, slope]))
    return record_local.alpha - record_local.cross @ solved[:, :-1], gradient - record_local.cross @ solved[
        :, -1
    ]


def _shared(record_local: _RecordLocal, features: Floats) -> list[tuple[float, float]]:
    """(log likelihood, v) for each v of the grid."""
    if not features.shape[1]:
        return [(record_local.log_likelihood, 0.0)]
    matrix, gradient = _projected(record_local)
    values, vectors = np.linalg.eigh(matrix)
    values = np.maximum(values, 0.0)
    squares = (vectors.T @ gradient) ** 2
    grid = np.square(_SHARED)[:, None]
    gains = 0.5 * (grid / (1.0 + grid * values) * squares - np.log1p(grid * values)).sum(axis=1)
    return [
        (record_local.log_likelihood + float(gain), strength**2)
        for gain, strength in zip(gains, _SHARED, strict=True)
    ]


def _amplitudes(
    component: Component,
    rotated: Component,
    vectors: Floats,
    record_local: _RecordLocal,
    features: Floats,
    v: float,
) -> Floats:
    """Posterior mean of a, with θ at its posterior mean."""
    k = component.gradient.shape[1]
    slope, _ = record_local.gradient
    alpha = np.zeros(features.shape[1] * k)
    if v > 0.0 and alpha.size:
        matrix, gradient = _projected(record_local)
        alpha = np.linalg.solve(matrix + np.eye(alpha.size) / v, gradient)
    theta = np.linalg.solve(record_local.theta, slope - record_local.cross.T @ alpha) if slope.size else slope
    common = features @ alpha.reshape(features.shape[1], k)
    remaining = rotated.gradient - rotated.cross @ theta - np.einsum("cik,ck->ci", rotated.square, common)
    return np.asarray(common + np.einsum("cki,ci->ck", vectors, record_local.weight * remaining))


def _explained(component: Component, normal: Normal, amplitudes: Floats) -> float:
    """Reduction of χ² by B·a, with the unknowns fitted before and after."""
    remaining = normal.gradient - np.einsum("ckp,ck->p", component.cross, amplitudes)
    square = np.einsum("ck,ckl,cl->", amplitudes, component.square, amplitudes, optimize=True)
    fall = 2.0 * float((amplitudes * component.gradient).sum()) - float(square)
    if not remaining.size:
        return fall
    before = float(normal.gradient @ np.linalg.solve(normal.matrix, normal.gradient))
    return fall + float(remaining @ np.linalg.solve(normal.matrix, remaining)) - before
