"""Cubic B-splines of what moves, as weights of a system's own terms in further columns.

A column of this kind is ``∂z/∂b`` at b = 0 of a term T that is multiplied by ``1 + b·B(x)``, B a B-spline of
``x = w·(y, u)``: its forcing is the packed ``∂f/∂a`` of the parameters a that carry T, times ``B(x)``. No
other machine code of the model is needed for it.

C. de Boor, A Practical Guide to Splines (1978), chapter X.
"""

from __future__ import annotations

from numba import njit

from rigctl.engine.kernels.calling import OPTIONS
from rigctl.engine.kernels.sizes import DEGREE, MORE_KNOTS


@njit(**OPTIONS)
def evaluate_splines(splines, n, inputs, y, u):
    """Every B-spline at a state and its inputs, into `splines.basis`; x is held within the inner knots."""
    functions = splines.functions
    for a in range(splines.arguments):
        x = 0.0
        for i in range(n):
            x += splines.weights[a * (n + inputs) + i] * y[i]
        for j in range(inputs):
            weight = splines.weights[a * (n + inputs) + n + j]
            if weight != 0.0:
                x += weight * u[j]
        first = a * (functions + MORE_KNOTS)
        low, high = splines.knots[first + DEGREE], splines.knots[first + functions]
        # beyond the inner knots the term keeps the weight that it has at the end
        x = min(max(x, low), high)
        # de Boor's recursion: the interval in which x lies, then the functions that are not zero there, from
        # degree 0 to 3
        span = DEGREE
        while span < functions - 1 and x >= splines.knots[first + span + 1]:
            span += 1
        for k in range(functions):
            splines.basis[a * functions + k] = 0.0
        index = a * functions + span
        splines.basis[index] = 1.0
        for degree in range(1, DEGREE + 1):
            # B of this degree from those of the one before, from the left one on
            saved = 0.0
            for r in range(degree):
                right = splines.knots[first + span + 1 + r]
                left = splines.knots[first + span + 1 + r - degree]
                earlier = splines.basis[index - degree + 1 + r] / (right - left)
                splines.basis[index - degree + 1 + r - 1] = saved + (right - x) * earlier
                saved = (x - left) * earlier
            splines.basis[index] = saved


@njit(**OPTIONS)
def add_splines(splines, active, scales, used, packed, m, factor, result):
    """Add ``factor·scale·∂f/∂a·B`` of each entry to `result` (rows, m).

    `active` (used, 5): place in `packed`, row, column, function, and a second one that multiplies the first,
    or -1.
    """
    for entry in range(used):
        weight = scales[entry] * splines.basis[active[5 * entry + 3]]
        second = active[5 * entry + 4]
        if second >= 0:
            weight *= splines.basis[second]
        if weight != 0.0:
            result[active[5 * entry + 1] * m + active[5 * entry + 2]] += (
                factor * weight * packed[active[5 * entry]]
            )
