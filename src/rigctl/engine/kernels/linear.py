"""Small dense linear systems, solved in place: LU with partial pivoting, matrices by rows.

Written out because a library call costs more than the work at this size. The solvers exchange all rows
before they eliminate, as the factorisation exchanged whole rows.
"""

from __future__ import annotations

from numba import njit

from rigctl.engine.kernels.calling import OPTIONS

_LARGEST_MULTIPLIER = 100.0


@njit(**OPTIONS)
def factorise(n, matrix, exchanges):
    """Replace `matrix` (n, n) by its LU factors, with the inverse of U's diagonal on the diagonal.

    `exchanges` (n) becomes the row exchanges.
    """
    for k in range(n):
        largest = k
        for i in range(k + 1, n):
            if abs(matrix[i * n + k]) > abs(matrix[largest * n + k]):
                largest = i
        exchanges[k] = largest
        if largest != k:
            for j in range(n):
                kept = matrix[k * n + j]
                matrix[k * n + j] = matrix[largest * n + j]
                matrix[largest * n + j] = kept
        inverse = 1.0 / matrix[k * n + k]
        matrix[k * n + k] = inverse
        for i in range(k + 1, n):
            factor = matrix[i * n + k] * inverse
            matrix[i * n + k] = factor
            if factor != 0.0:
                for j in range(k + 1, n):
                    matrix[i * n + j] -= factor * matrix[k * n + j]


@njit(**OPTIONS)
def factorise_in_order(n, matrix, exchanges, unit, size):
    """As `factorise`, without exchanging rows; False, with the matrix spoilt, where that would not be safe.

    Looking for exchanges, and the zeros that they fill, take longer than the elimination. It is as exact
    without as long as no multiplier is large, where each row is taken relative to its largest entry `size`
    (n, found here) and each column in the `unit` (n) of its unknown. That is scaled partial pivoting, content
    with a pivot that is not the best (N. J. Higham, Accuracy and Stability of Numerical Algorithms, 9).
    """
    for i in range(n):
        largest = 0.0
        for j in range(n):
            entry = abs(matrix[i * n + j]) * unit[j]
            if entry > largest:  # noqa: PLR1730 - max() of numba also orders nan and takes twice as long
                largest = entry
        size[i] = largest
    for k in range(n):
        exchanges[k] = k
        inverse = 1.0 / matrix[k * n + k]
        matrix[k * n + k] = inverse
        for i in range(k + 1, n):
            factor = matrix[i * n + k]
            if factor != 0.0:
                factor *= inverse
                # written so that nan is refused
                if not abs(factor) * size[k] <= _LARGEST_MULTIPLIER * size[i]:
                    return False
                matrix[i * n + k] = factor
                for j in range(k + 1, n):
                    matrix[i * n + j] -= factor * matrix[k * n + j]
    return True


@njit(**OPTIONS)
def solve(n, matrix, exchanges, b):
    """Replace `b` (n) by the solution of the factorised system."""
    for k in range(n):
        other = exchanges[k]
        if other != k:
            kept = b[k]
            b[k] = b[other]
            b[other] = kept
    # by columns: the updates of one column do not wait for each other
    for k in range(n):
        known = b[k]
        for i in range(k + 1, n):
            b[i] -= matrix[i * n + k] * known
    for k in range(n - 1, -1, -1):
        known = b[k] * matrix[k * n + k]
        b[k] = known
        for i in range(k):
            b[i] -= matrix[i * n + k] * known


@njit(**OPTIONS)
def solve_columns(n, m, matrix, exchanges, b):
    """Replace every column of `b` (n, m) by the solution of the factorised system."""
    for k in range(n):
        other = exchanges[k]
        if other != k:
            for c in range(m):
                kept = b[k * m + c]
                b[k * m + c] = b[other * m + c]
                b[other * m + c] = kept
    for i in range(1, n):
        for k in range(i):
            factor = matrix[i * n + k]
            if factor != 0.0:
                for c in range(m):
                    b[i * m + c] -= factor * b[k * m + c]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            factor = matrix[i * n + k]
            if factor != 0.0:
                for c in range(m):
                    b[i * m + c] -= factor * b[k * m + c]
        inverse = matrix[i * n + i]
        for c in range(m):
            b[i * m + c] *= inverse
