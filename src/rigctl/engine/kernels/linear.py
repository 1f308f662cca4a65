"""Small dense linear systems, solved in place: LU with partial pivoting, matrices by rows.

Written out because a library call costs more than the work at this size. All rows of a right-hand side are
exchanged before it is eliminated, as the factorisation exchanged whole rows. What needs no exchange is
factorised and solved by code of the model's own: see `engine.elimination`.
"""

from __future__ import annotations

from numba import njit

from rigctl.engine.kernels.calling import OPTIONS


@njit(**OPTIONS)
def factorise(n, matrix, exchanges):
    """Replace `matrix` (n, n) by its LU factors, with the inverse of U's diagonal on the diagonal.

    `exchanges` (n) becomes the row exchanges.
    """
    for k in range(n):
        # the largest pivot of the column, for which all of this exists: where the model's own elimination was
        # refused
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
def exchange_rows(n, m, exchanges, b):
    """Exchange the rows of `b` (n, m) as the factorisation exchanged its own."""
    for k in range(n):
        other = exchanges[k]
        if other != k:
            for c in range(m):
                kept = b[k * m + c]
                b[k * m + c] = b[other * m + c]
                b[other * m + c] = kept


@njit(**OPTIONS)
def solve(n, matrix, exchanges, b):
    """Replace `b` (n) by the solution of the factorised system."""
    exchange_rows(n, 1, exchanges, b)
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
def solve_columns(n, m, matrix, b):
    """Replace every column of `b` (n, m), its rows exchanged, by the solution of the factorised system."""
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
