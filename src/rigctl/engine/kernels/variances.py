"""The variances of many readings as a sum of a few known terms: the most likely coefficients."""

from __future__ import annotations

import math

from numba import njit

from rigctl.engine.kernels.calling import OPTIONS, floats_1, floats_2, integers_1, offset, pointer_to
from rigctl.engine.kernels.sizes import LANES, TILE

#: a smaller variance, or sum of weights, counts as this one: it is divided by
_NOTHING = 1e-300


@njit(**OPTIONS)
def weigh(columns, size, count, terms, squares, variance, weight, pull):
    """Fill `weight` with 1/μ and `pull` with v/μ² for a tile, with μ = Σ_k s_k·t_k of at most three terms."""
    second, third = offset(terms, count * min(1, columns - 1)), offset(terms, count * (columns - 1))
    a, b, c = squares[0], squares[1] if columns > 1 else 0.0, squares[2] if columns > 2 else 0.0
    for i in range(size):
        mean = a * terms[i] + b * second[i] + c * third[i]
        inverse = 1.0 / max(mean, _NOTHING)
        weight[i] = inverse
        pull[i] = variance[i] * inverse * inverse


@njit(**OPTIONS)
def add_products(size, row, weight, pull, sums):
    """Add ``row_i·weight_i`` to the first eight of `sums`, and ``row_i·pull_i`` to the others.

    Every eighth goes to the same sum: written so for vector instructions, of which two chains do not wait for
    each other.
    """
    a, b, c, d, e, f, g, h = sums[0], sums[1], sums[2], sums[3], sums[4], sums[5], sums[6], sums[7]
    s, t, u, v, w, x, y, z = sums[8], sums[9], sums[10], sums[11], sums[12], sums[13], sums[14], sums[15]
    for i in range(0, size, LANES):
        a += row[i] * weight[i]
        b += row[i + 1] * weight[i + 1]
        c += row[i + 2] * weight[i + 2]
        d += row[i + 3] * weight[i + 3]
        e += row[i + 4] * weight[i + 4]
        f += row[i + 5] * weight[i + 5]
        g += row[i + 6] * weight[i + 6]
        h += row[i + 7] * weight[i + 7]
        s += row[i] * pull[i]
        t += row[i + 1] * pull[i + 1]
        u += row[i + 2] * pull[i + 2]
        v += row[i + 3] * pull[i + 3]
        w += row[i + 4] * pull[i + 4]
        x += row[i + 5] * pull[i + 5]
        y += row[i + 6] * pull[i + 6]
        z += row[i + 7] * pull[i + 7]
    sums[0], sums[1], sums[2], sums[3], sums[4], sums[5], sums[6], sums[7] = a, b, c, d, e, f, g, h
    sums[8], sums[9], sums[10], sums[11], sums[12], sums[13], sums[14], sums[15] = s, t, u, v, w, x, y, z


@njit(**OPTIONS)
def total(sums):
    """The sum of the eight `sums`."""
    return ((sums[0] + sums[1]) + (sums[2] + sums[3])) + ((sums[4] + sums[5]) + (sums[6] + sums[7]))


def most_likely(words):
    """Lower ``Σ_i (ln μ_i + v_i/μ_i)``, ``μ_i = Σ_k s_k·t_ki``, by multiplications of the coefficients s.

    `words` describe the arrays, see `sizes.WORDS`: the largest number of steps (1); terms (k, n) t, at most
    three; variance (n) v; squares (k) s, the start and then the result; and a workspace, two tiles and
    (2k, `LANES`) sums. n is a multiple of `LANES`; readings whose terms and variance are all 0 do not count.

    ``s_k ← s_k·√(Σ_i t_ki·v_i/μ_i² / Σ_i t_ki/μ_i)`` until nothing changes, or the steps are used up.
    """
    steps = integers_1(words, 0)[0]
    table = floats_2(words, 1)
    columns, count = table.shape
    terms, variance = pointer_to(table), pointer_to(floats_1(words, 2))
    squares, weight = pointer_to(floats_1(words, 3)), pointer_to(floats_1(words, 4))
    pull = offset(weight, TILE)
    sums = offset(pull, TILE)
    # every step is one pass through the readings, tile by tile: μ and its inverses are used for all terms
    # while they are in the nearest cache
    for _ in range(steps):
        for i in range(2 * columns * LANES):
            sums[i] = 0.0
        for begin in range(0, count, TILE):
            size = min(TILE, count - begin)
            tile = offset(terms, begin)
            weigh(columns, size, count, tile, squares, offset(variance, begin), weight, pull)
            for k in range(columns):
                row = offset(tile, k * count)
                add_products(size, row, weight, pull, offset(sums, 2 * k * LANES))
        moved = False
        for k in range(columns):
            down = offset(sums, 2 * k * LANES)
            weights = total(down)
            after = squares[k] * math.sqrt(total(offset(down, LANES)) / max(weights, _NOTHING))
            moved = moved or after != squares[k]
            squares[k] = after
        if not moved:
            return
