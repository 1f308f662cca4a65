"""A Gauss-Newton step inside a box.

If an unconstrained step is merely truncated at the bounds, a fit creeps along them and stalls, because the
steps of the other parameters still compensate for the part that was cut off. Here a parameter that would
leave the box is held at its edge and the others are solved for again; one that would return inside is
released.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rigctl.engine.least_squares.arrow import Arrow, Vector, eliminate

Floats = NDArray[np.float64]

_ROUNDS = 25


def bounded_step(arrow: Arrow, weight: Vector, target: Vector, lower: Vector, upper: Vector) -> Vector:
    """The step with the smallest sum of squares between `lower` <= 0 and `upper` >= 0.

    Parameters
    ----------
    arrow: the linearised records.
    weight, target: an additional equation ``weight·step = target`` for each parameter: damping and priors.
    """
    # an active set: solve for the free ones, hold those that left the box, solve again. Each may be released
    # only once, without which two could take turns for ever
    low, high = lower.flat(), upper.flat()
    free, fixed = np.ones(low.size), np.zeros(low.size)
    released = np.zeros(low.size, dtype=bool)
    for _ in range(_ROUNDS):
        solved = eliminate(arrow, weight, target, lower.like(free), lower.like(fixed)).solve()
        step = _complete(solved, free, fixed, lower)
        outside = (free > 0.0) & ((step < low) | (step > high))
        if outside.any():
            free[outside] = 0.0
            fixed[outside] = np.clip(step, low, high)[outside]
            continue
        # a held parameter whose gradient points inside is released, once
        pull = _pull(arrow, weight, target, lower.like(step))
        inwards = ((fixed >= high) & (pull < 0.0)) | ((fixed <= low) & (pull > 0.0))
        back = (free == 0.0) & inwards & ~released & (low < high)
        if not back.any():
            break
        released |= back
        free[back], fixed[back] = 1.0, 0.0
    return lower.like(np.clip(step, low, high))


def _complete(solved: Vector, free: Floats, fixed: Floats, like: Vector) -> Floats:
    """The solved steps of the free parameters and the given ones of the others, in one array."""
    step = fixed.copy()
    mask = like.like(free)
    pieces = like.like(step)
    for values, is_free, solution in zip(
        (pieces.shared, *pieces.local),
        (mask.shared, *mask.local),
        (solved.shared, *solved.local),
        strict=True,
    ):
        values[is_free > 0.0] = solution
    return pieces.flat()


def _pull(arrow: Arrow, weight: Vector, target: Vector, step: Vector) -> Floats:
    """The direction of each parameter from `step`: minus the gradient of the sum of squares there."""
    shared = weight.shared * (target.shared - weight.shared * step.shared)
    record_local = []
    for k, (triangle, m) in enumerate(zip(arrow.triangles, arrow.local, strict=True)):
        residual = triangle[:, -1] - triangle[:, :m] @ step.local[k] - triangle[:, m:-1] @ step.shared
        shared = shared + triangle[:, m:-1].T @ residual
        given = weight.local[k] * (target.local[k] - weight.local[k] * step.local[k])
        record_local.append(given + triangle[:, :m].T @ residual)
    return np.concatenate([shared, *record_local])
