"""One step of ESDIRK3(2), and the exact derivative of that step.

Kværnø's 3/2a: four stages, the first explicit, the others with the same gamma; L-stable and stiffly accurate,
with an embedded second-order solution that is L-stable too.

    z_i = y + h·sum(a_ij·k_j, j <= i),   k_i = f(z_i),   y_next = z_3,   error ~ z_3 - z_2

A. Kværnø, Singly diagonally implicit Runge-Kutta methods with an explicit first stage, BIT 44 (2004).
The sensitivities are those of the steps that were taken (internal differentiation): each stage's equation
is differentiated and solved with the Jacobian at that very stage, so they are exact to rounding whatever
the step size. H. G. Bock, Recent advances in parameter identification for ODE (1983).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from rigctl.engine.kernels.calling import (
    FACTORISE,
    OPTIONS,
    RHS,
    RHS_TANGENT,
    SOLVE,
    call_2,
    call_4,
    call_5,
    call_6,
    offset,
)
from rigctl.engine.kernels.linear import exchange_rows, factorise, solve, solve_columns
from rigctl.engine.kernels.splines import add_splines, evaluate_splines

GAMMA = 0.43586652150845906
A = np.zeros((4, 3))
A[1, 0] = GAMMA
A[2, 0] = (-4 * GAMMA**2 + 6 * GAMMA - 1) / (4 * GAMMA)
A[2, 1] = (1 - 2 * GAMMA) / (4 * GAMMA)
A[3, 0] = (6 * GAMMA - 1) / (12 * GAMMA)
A[3, 1] = -1 / ((24 * GAMMA - 12) * GAMMA)
A[3, 2] = (-6 * GAMMA**2 + 6 * GAMMA - 1) / (6 * GAMMA - 3)

#: abscissa of each stage: the sum of its row
C = np.array([0.0, 2.0 * GAMMA, 1.0, 1.0])

CONVERGED, SLOW, NOT_FINITE = 0, 1, 2

_ITERATIONS = 8
_SMALL_CORRECTION = 1e-2  # of the tolerance
_FASTEST_RATE = 1e-2  # limit of the convergence rate that one stage passes to the next


@njit(**OPTIONS)
def set_matrix(addresses, work, h_gamma):
    """Factorise ``I - h·gamma·∂f/∂y``: in order as the model's code has it, or with exchanges of rows."""
    n = work.n
    if work.exchanged[0]:  # what the model's code takes for zero was filled in
        for i in range(n * n):
            work.matrix[i] = 0.0
        work.exchanged[0] = 0
    work.reach[0] = h_gamma
    call_5(addresses[FACTORISE], work.jacobian, work.unit, work.reach, work.matrix, offset(work.reach, 1))
    if work.reach[1] == 0.0:
        return
    work.exchanged[0] = 1
    for i in range(n * n):
        work.matrix[i] = -h_gamma * work.jacobian[i]
    for i in range(n):
        work.matrix[i * n + i] += 1.0
    factorise(n, work.matrix, work.exchanges)


@njit(**OPTIONS)
def correct(addresses, work):
    """Replace `work.correction` by the solution of the factorised system."""
    if work.exchanged[0]:
        solve(work.n, work.matrix, work.exchanges, work.correction)
    else:
        call_2(addresses[SOLVE], work.matrix, work.correction)


@njit(**OPTIONS)
def solve_stage(addresses, u, q, z, h_gamma, rate, work):
    """Newton's iteration for ``z = base + h·gamma·f(z)``, with the matrix of the step's start.

    `rate` is by how much each correction was smaller than the one before, in the step's last stage: where
    that foretells a small error the first correction is the last. Returns (outcome, rate).

    E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, IV.8.
    """
    n = work.n
    # one matrix for all three stages, of the Jacobian at the step's start: the iteration converges linearly,
    # and `rate` is its factor
    previous = math.inf
    for iteration in range(_ITERATIONS):
        call_4(addresses[RHS], z, u, q, work.value)
        # the residual of the stage's equation, base + h·γ·f(z) - z, through the matrix: Newton's correction
        for i in range(n):
            work.correction[i] = work.base[i] + h_gamma * work.value[i] - z[i]
        correct(addresses, work)
        total = 0.0
        for i in range(n):
            z[i] += work.correction[i]
            scaled = work.correction[i] * work.weight[i]
            total += scaled * scaled
        size = math.sqrt(total / n)
        if not math.isfinite(size):
            return NOT_FINITE, rate
        if iteration > 0:
            rate = max(_FASTEST_RATE, size / previous)
        # what is left after it is size·rate/(1 - rate): a hundredth of the tolerance, so that the error
        # estimate below is that of the method, and not of the iteration
        if size < _SMALL_CORRECTION or size * rate < _SMALL_CORRECTION * (1.0 - rate):
            return CONVERGED, rate
        if iteration > 1 and rate > 2.0:
            return SLOW, rate
        previous = size
    return SLOW, rate


@njit(**OPTIONS)
def inputs_at(stage, h, switches, ramped):
    """The inputs at a stage: those that act now, moved along their slopes where some change steadily."""
    if not ramped:
        return switches.u
    reach = h * C[stage]
    for j in range(switches.inputs):
        switches.stage[j] = switches.u[j] + reach * switches.slope[j]
    return switches.stage


@njit(**OPTIONS)
def attempt(addresses, switches, ramped, q, h, work):
    """Try a step of length h from `work.y`, whose derivative is the first of `work.k`.

    Returns (outcome, error in units of the tolerance). The new state is the last of `work.z`, its derivative
    the last of `work.k`. The error is filtered by the step's matrix, as stiff components would spoil it.
    """
    # z_i = base + h·γ·f(z_i) with base = y + h·Σ a_ij·k_j over the earlier stages j < i; each z starts at a
    # prediction, which decides how many iterations it takes
    n, y = work.n, work.y
    h_gamma = h * GAMMA
    inverse = 1.0 / h_gamma
    set_matrix(addresses, work, h_gamma)
    rate = 1.0
    for stage in range(1, 4):
        z, k = offset(work.z, stage * n), offset(work.k, stage * n)
        for i in range(n):
            total = y[i]
            for j in range(stage):
                total += h * A[stage, j] * work.k[j * n + i]
            work.base[i] = total
            if stage == 1:
                z[i] = y[i] + 2.0 * h_gamma * work.k[i]
            elif stage == 2:
                # the parabola through the first stage, with the slope at the start
                bend = work.z[n + i] - y[i] - 2.0 * h_gamma * work.k[i]
                z[i] = y[i] + h * work.k[i] + bend / (4.0 * GAMMA * GAMMA)
            else:
                z[i] = work.z[2 * n + i]
        u = inputs_at(stage, h, switches, ramped)
        outcome, rate = solve_stage(addresses, u, q, z, h_gamma, rate, work)
        if outcome != CONVERGED:
            return outcome, math.inf
        # k from the stage's equation rather than from f: it is as accurate as z, and costs no evaluation
        for i in range(n):
            k[i] = (z[i] - work.base[i]) * inverse
    # the error is the difference to the embedded solution, of order h³, through the matrix, which leaves slow
    # components as they are and damps those that a step of this length does not resolve
    for i in range(n):
        work.correction[i] = work.z[3 * n + i] - work.z[2 * n + i]
    correct(addresses, work)
    total = 0.0
    for i in range(n):
        work.correction[i] *= work.weight[i]
        total += work.correction[i] * work.correction[i]
    error = math.sqrt(total / n)
    if not math.isfinite(error):
        return NOT_FINITE, math.inf
    return CONVERGED, error


@njit(**OPTIONS)
def set_fixed(stage, block, h, work):
    """The known part of a stage's sensitivities: ``s + h·sum(a_ij·dk_j, j < i)``.

    Into `work.fixed` and `work.moving`; a loop for each stage, as one goes through memory once.
    """
    first, second, third = work.dk, offset(work.dk, block), offset(work.dk, 2 * block)
    one, two, three = h * A[stage, 0], h * A[stage, 1], h * A[stage, 2]
    if stage == 1:
        for i in range(block):
            total = work.s[i] + one * first[i]
            work.fixed[i] = total
            work.moving[i] = total
    elif stage == 2:
        for i in range(block):
            total = work.s[i] + one * first[i] + two * second[i]
            work.fixed[i] = total
            work.moving[i] = total
    else:
        for i in range(block):
            total = work.s[i] + one * first[i] + two * second[i] + three * third[i]
            work.fixed[i] = total
            work.moving[i] = total


@njit(**OPTIONS)
def tangent(addresses, switches, ramped, q, h, work):
    """Carry the sensitivities `work.s` and their derivative, the first of `work.dk`, over the accepted step.

    Leaves the Jacobian of the new state in `work.jacobian`.
    """
    # each stage differentiated: S_i = s + h·Σ a_ij·dS_j + h·γ·(J_i·S_i + ∂f/∂q), all columns by one matrix,
    # (I - h·γ·J_i)·S_i = fixed + h·γ·∂f/∂q. J_i is that at the stage itself, not that of the step's start,
    # with which Newton's iteration makes do: only so are these the derivatives of the numbers computed
    n, m = work.n, work.m
    block = n * m
    h_gamma = h * GAMMA
    inverse = 1.0 / h_gamma
    for stage in range(1, 4):
        z, dk = offset(work.z, stage * n), offset(work.dk, stage * block)
        u = inputs_at(stage, h, switches, ramped)
        call_6(addresses[RHS_TANGENT], z, u, q, work.value, work.jacobian, work.packed)
        set_matrix(addresses, work, h_gamma)
        # `fixed` is S without the implicit part, `moving` becomes the right-hand side and then S
        set_fixed(stage, block, h, work)
        for entry in range(work.used):
            index, row, column = (
                work.active[3 * entry],
                work.active[3 * entry + 1],
                work.active[3 * entry + 2],
            )
            work.moving[row * m + column] += h_gamma * work.packed[index]
        splines = work.splines
        if splines.rhs_used:
            evaluate_splines(splines, n, switches.inputs, z, u)
            add_splines(
                splines,
                splines.rhs,
                splines.rhs_scales,
                splines.rhs_used,
                work.packed,
                m,
                h_gamma,
                work.moving,
            )
        if work.exchanged[0]:
            exchange_rows(n, m, work.exchanges, work.moving)
        solve_columns(n, m, work.matrix, work.moving)
        for i in range(block):
            dk[i] = (work.moving[i] - work.fixed[i]) * inverse
    # stiffly accurate: the last stage is the new state, so that its sensitivities, their derivative and its
    # Jacobian are those with which the next step begins
    for i in range(block):
        work.s[i] = work.moving[i]
        work.dk[i] = work.dk[3 * block + i]
