"""RODAS: a stiffly accurate Rosenbrock method of order 4(3), the integrator of the separate bench.

    (I/(hγ) − J) k_i = f(y + Σ_j a_ij k_j) + Σ_j (c_ij/h) k_j,   y⁺ = y + Σ_j m_j k_j

Chosen because it has nothing in common with the engine's method: no Newton iteration, no stage derivatives,
a Jacobian by differences. Coefficients: Hairer & Wanner, *Solving Ordinary Differential Equations II*, §IV.7
and their code RODAS.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from rigctl_validation.bench.compiled import compiled
from rigctl_validation.bench.equations import rhs

GAMMA = 0.25
#: a_ij of the stages 2 to 5; the last two add the stage before with weight 1
A = np.array([
    [0.0, 0.0, 0.0, 0.0, 0.0],
    [1.544000000000000, 0.0, 0.0, 0.0, 0.0],
    [0.9466785280815826, 0.2557011698983284, 0.0, 0.0, 0.0],
    [3.314825187068521, 2.896124015972201, 0.9986419139977817, 0.0, 0.0],
    [1.221224509226641, 6.019134481288629, 12.53708332932087, -0.6878860361058950, 0.0],
    [1.221224509226641, 6.019134481288629, 12.53708332932087, -0.6878860361058950, 1.0],
])  # fmt: skip
#: c_ij
C = np.array([
    [0.0, 0.0, 0.0, 0.0, 0.0],
    [-5.6688, 0.0, 0.0, 0.0, 0.0],
    [-2.430093356833875, -0.2063599157091915, 0.0, 0.0, 0.0],
    [-0.1073529058151375, -9.594562251023355, -20.47028614809616, 0.0, 0.0],
    [7.496443313967647, -10.24680431464352, -33.99990352819905, 11.70890893206160, 0.0],
    [8.083246795921522, -7.981132988064893, -31.52159432874371, 16.31930543123136, -6.058818238834054],
])  # fmt: skip
STAGES = 6

SMALLEST_STEP = 1e-12  # s; a smaller step indicates an error of the equations, not of the method


@njit
def factorise(matrix, pivots):
    """LU decomposition in place with partial pivoting."""
    n = matrix.shape[0]
    for k in range(n):
        best = k
        for i in range(k + 1, n):
            if abs(matrix[i, k]) > abs(matrix[best, k]):
                best = i
        pivots[k] = best
        if best != k:
            for j in range(n):
                matrix[k, j], matrix[best, j] = matrix[best, j], matrix[k, j]
        for i in range(k + 1, n):
            matrix[i, k] /= matrix[k, k]
            for j in range(k + 1, n):
                matrix[i, j] -= matrix[i, k] * matrix[k, j]


@njit
def solve(matrix, pivots, right):
    """Solve in place with the factors of `factorise`."""
    n = matrix.shape[0]
    for k in range(n):
        if pivots[k] != k:
            right[k], right[pivots[k]] = right[pivots[k]], right[k]
    for i in range(1, n):
        for j in range(i):
            right[i] -= matrix[i, j] * right[j]
    for i in range(n - 1, -1, -1):
        for j in range(i + 1, n):
            right[i] -= matrix[i, j] * right[j]
        right[i] /= matrix[i, i]


@njit
def jacobian(y, inputs, bench, scale, f, shifted, matrix):
    """∂f/∂y by central differences, column by column."""
    n = y.size
    for j in range(n):
        step = 1e-7 * (abs(y[j]) + scale[j])
        original = y[j]
        for side in (1.0, -1.0):
            y[j] = original + side * step
            shifted[:] = f
            rhs(y, inputs, bench, f)
        y[j] = original
        for i in range(n):
            matrix[i, j] = (shifted[i] - f[i]) / (2.0 * step)


@compiled
def integrate(y, duration, first_step, inputs, bench, scale, tolerance):
    """Advance `y` in place by `duration` seconds of constant inputs; returns the last step, or −1 on failure.

    `scale` is the absolute tolerance of each state: the error of a step is weighted by
    tolerance·(scale + |y|).
    """
    n = y.size
    f, work, trial = np.empty(n), np.empty(n), np.empty(n)
    k = np.empty((STAGES, n))
    jac, matrix, pivots = np.empty((n, n)), np.empty((n, n)), np.empty(n, np.int64)
    time, h, wanted = 0.0, min(first_step, duration), first_step
    fresh = False
    while time < duration * (1.0 - 1e-13):
        h = min(wanted, duration - time)
        if not fresh:
            jacobian(y, inputs, bench, scale, f, work, jac)
            fresh = True
        for i in range(n):
            for j in range(n):
                matrix[i, j] = -jac[i, j]
            matrix[i, i] += 1.0 / (h * GAMMA)
        factorise(matrix, pivots)
        stages(y, h, inputs, bench, matrix, pivots, trial, work, k)
        error = 0.0
        for i in range(n):
            part = k[5, i] / (tolerance * (scale[i] + max(abs(y[i]), abs(trial[i]))))
            error += part * part
        error = math.sqrt(error / n)
        if not math.isfinite(error):
            error = 1e6
        if error <= 1.0:
            time += h
            y[:] = trial
            fresh = False
        wanted = h * min(6.0, max(0.2, 0.9 * max(error, 1e-10) ** -0.25))
        if wanted < SMALLEST_STEP:
            return -1.0
    return wanted


@njit
def stages(y, h, inputs, bench, matrix, pivots, trial, f, k):
    """The six stages; leaves y⁺ in `trial` and the error estimate in ``k[5]``."""
    n = y.size
    for stage in range(STAGES):
        for i in range(n):
            trial[i] = y[i]
            for j in range(stage):
                trial[i] += A[stage, j] * k[j, i]
        rhs(trial, inputs, bench, f)
        for i in range(n):
            k[stage, i] = f[i]
            for j in range(stage):
                k[stage, i] += C[stage, j] * k[j, i] / h
        solve(matrix, pivots, k[stage])
    for i in range(n):
        trial[i] += k[5, i]


@compiled
def follow(states, time, switch_times, commands, inputs, bench, scale, first_step, tolerance):
    """Fill `states` (samples, STATES) from its first row on; False when the integration failed.

    Commands change at `switch_times`, whose first is at or before ``time[0]``; after each the step is small
    again.
    """
    state, excitation = states[0].copy(), inputs.copy()
    excitation[0] = commands[0]
    now, step, switch, sample = time[0], first_step, 1, 1
    while sample < time.size:
        switching = switch < switch_times.size and switch_times[switch] < time[sample] - 1e-12
        until = switch_times[switch] if switching else time[sample]
        if until - now > 1e-12:
            step = integrate(state, until - now, step, excitation, bench, scale, tolerance)
            if step < 0.0:
                return False
            now = until
        if switching:
            step, excitation[0] = first_step, commands[switch]
            switch += 1
        else:
            states[sample] = state
            sample += 1
    return True
