"""The restricted likelihood of coloured noise under trends: the sums over all windows that it is made of."""

from __future__ import annotations

import math

from numba import njit

from rigctl.engine.kernels.calling import OPTIONS, floats_1, integers_2, offset, pointer_to


@njit(**OPTIONS)
def whiten_row(count, kept, below, scale, before, row, last, z):
    """The innovations of one sample of every column: ``y ← x − r·x' − l·y'`` in `last`, ``s·y`` in `z`."""
    for k in range(count):
        value = row[k] - kept * before[k] - below * last[k]
        last[k] = value
        z[k] = scale * value


@njit(**OPTIONS)
def add_products(count, orders, z, products, squares):
    """Add ``z_j·z_k`` to the products of each column j of the trend, and ``z_k²`` to the squares."""
    for j in range(orders):
        row = offset(products, j * count)
        factor = z[j]
        for k in range(count):
            row[k] += factor * z[k]
    for k in range(count):
        squares[k] += z[k] * z[k]


@njit(**OPTIONS)
def eliminate(count, orders, products):
    """``ln|N|`` and ``Σ aᵀN⁻¹a`` of products [N, a], which become triangular."""
    logarithm = explained = 0.0
    for j in range(orders):
        row = offset(products, j * count)
        pivot = row[j]
        logarithm += math.log(abs(pivot))
        for i in range(j + 1, orders):
            other = offset(products, i * count)
            factor = other[j] / pivot
            for k in range(j, count):
                other[k] -= factor * row[k]
        for k in range(orders, count):
            explained += row[k] * row[k] / pivot
    return logarithm, explained


@njit(**OPTIONS)
def whiten(samples, count, orders, steps, columns, rho, white, work):
    """``ln|R|`` of a window; `work` is left with the squares and the products of its whitened columns.

    The factors of R are those of `rigctl.noise.autoregression.Innovations`, made along the way.
    """
    last = work
    z, squares = offset(work, count), offset(work, 2 * count)
    for k in range((orders + 3) * count):
        work[k] = 0.0
    logarithm = below = kept = 0.0
    diagonal, step = 1.0, 0.0
    before = columns
    for i in range(samples):
        # the innovation of a first-order autoregression with white noise on top: one row of the Cholesky
        # factor of its tridiagonal covariance, from the row before
        row = offset(columns, i * count)
        if i > 0:
            if steps[i] != step:
                step = steps[i]
                kept = rho**step
            below = -white * kept / diagonal
            variance = (1.0 - white) * (1.0 - kept * kept) + white * (1.0 + kept * kept)
            diagonal = variance - below * below * diagonal
            logarithm += math.log(diagonal)
        whiten_row(count, kept, below, 1.0 / math.sqrt(diagonal), before, row, last, z)
        add_products(count, orders, z, offset(squares, count), squares)
        before = row
    return logarithm


def restricted(words):
    """Σ m·(ln|R| + ln|XᵀR⁻¹X|) and Q of `rigctl.noise.reml.fit_noise`, over groups of m windows each.

    `words` describe the arrays, see `sizes.WORDS`: sizes (groups, 4) of samples, columns, columns of the
    trend, m; steps, of each group the times from one sample to the next, the first 0; columns, of each group
    (samples, columns) the trend and then the windows; at (2) ρ and w; found (2) the result; and a workspace,
    (columns of the trend + 3)·columns of the largest group.
    """
    sizes = integers_2(words, 0)
    steps, columns = pointer_to(floats_1(words, 1)), pointer_to(floats_1(words, 2))
    at, found = pointer_to(floats_1(words, 3)), pointer_to(floats_1(words, 4))
    work = pointer_to(floats_1(words, 5))
    determinant = quadratic = 0.0
    for group in range(sizes.shape[0]):
        samples, count, orders = sizes[group, 0], sizes[group, 1], sizes[group, 2]
        logarithm = whiten(samples, count, orders, steps, columns, at[0], at[1], work)
        of_trend, explained = eliminate(count, orders, offset(work, 3 * count))
        determinant += sizes[group, 3] * (logarithm + of_trend)
        squares = offset(work, 2 * count)
        for k in range(orders, count):
            quadratic += squares[k]
        quadratic -= explained
        steps = offset(steps, samples)
        columns = offset(columns, samples * count)
    found[0], found[1] = determinant, quadratic
