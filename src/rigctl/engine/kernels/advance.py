"""Adaptive steps from one moment to another while the inputs are constant, or change steadily.

`record` goes from event to event; this goes from one event to the next, in as many steps of `esdirk` as the
tolerances ask for. `restart` evaluates the derivatives after an event and proposes the first step, `advance`
steps until exactly the next event. The error of a step, in units of ``absolute + relative·|y|``, is
proportional to h³, hence

    h_next = 0.9·h·error^(-1/3),   a step with error > 1 is taken again with it.
"""

from __future__ import annotations

import math

from numba import njit

from rigctl.engine.kernels.calling import (
    OPTIONS,
    RHS,
    RHS_JACOBIAN,
    RHS_TANGENT,
    call_4,
    call_5,
    call_6,
    offset,
)
from rigctl.engine.kernels.esdirk import CONVERGED, NOT_FINITE, attempt, tangent
from rigctl.engine.kernels.outcomes import (
    DONE,
    GUILTY_STATE,
    NOT_FINITE_RHS,
    REJECTED,
    RESTARTS,
    STEP_TOO_SMALL,
    STEPS,
    TOO_MANY_STEPS,
)
from rigctl.engine.kernels.splines import add_splines, evaluate_splines

_MOST_STEPS = 2_000_000
_ROUNDING = 1e-15
_FIRST_CHANGE = 0.01  # share of the tolerance, for the derivative left out of the first step's formula


@njit(**OPTIONS)
def set_weights(work, relative, absolute):
    """The tolerance of each state here, ``absolute + relative·|y|``, and its inverse."""
    for i in range(work.n):
        work.unit[i] = absolute[i] + relative * abs(work.y[i])
        work.weight[i] = 1.0 / work.unit[i]


@njit(**OPTIONS)
def restart(addresses, u, q, inputs, work, relative, absolute, sensitive, counters):
    """Derivatives at the present state, after a start or a switch. Returns (outcome, first step to try).

    The first step is Hairer's: from the sizes of the state, its derivative, and how fast that changes.
    E. Hairer, S. P. Nørsett, G. Wanner, Solving Ordinary Differential Equations I, II.4.
    """
    n, m = work.n, work.m
    counters[RESTARTS] += 1
    if n == 0:  # static: nothing moves between two switches
        return DONE, math.inf
    # k = f and dk = J·s + ∂f/∂q at this state: the explicit first stage of the next step
    if sensitive:
        call_6(addresses[RHS_TANGENT], work.y, u, q, work.k, work.jacobian, work.packed)
        for i in range(n):
            for c in range(m):
                total = 0.0
                for j in range(n):
                    total += work.jacobian[i * n + j] * work.s[j * m + c]
                work.dk[i * m + c] = total
        for entry in range(work.used):
            index, row, column = (
                work.active[3 * entry],
                work.active[3 * entry + 1],
                work.active[3 * entry + 2],
            )
            work.dk[row * m + column] += work.packed[index]
        splines = work.splines
        if splines.rhs_used:
            evaluate_splines(splines, n, inputs, work.y, u)
            add_splines(
                splines, splines.rhs, splines.rhs_scales, splines.rhs_used, work.packed, m, 1.0, work.dk
            )
    else:
        call_4(addresses[RHS], work.y, u, q, work.k)
    # a first probe, in which an explicit step would change the state by a hundredth of its size; then, by how
    # fast f changes over it, the step whose error is small, of order h³, hence the cube root
    set_weights(work, relative, absolute)
    size, slope = 0.0, 0.0
    for i in range(n):
        if not math.isfinite(work.k[i]):
            counters[GUILTY_STATE] = i
            return NOT_FINITE_RHS, 0.0
        value, change = work.y[i] * work.weight[i], work.k[i] * work.weight[i]
        size += value * value
        slope += change * change
    size, slope = math.sqrt(size / n), math.sqrt(slope / n)
    probe = 0.01 * size / slope if size > 1e-5 and slope > 1e-5 else 1e-6
    for i in range(n):
        work.z[n + i] = work.y[i] + probe * work.k[i]
    call_4(addresses[RHS], offset(work.z, n), u, q, work.value)
    bend = 0.0
    for i in range(n):
        change = (work.value[i] - work.k[i]) * work.weight[i]
        bend += change * change
    bend = math.sqrt(bend / n) / probe
    fastest = max(slope, bend)
    if not math.isfinite(fastest):
        return DONE, 1e-3 * probe
    return DONE, min(100.0 * probe, (_FIRST_CHANGE / fastest) ** (1.0 / 3.0) if fastest > 1e-15 else 1e3)


@njit(**OPTIONS)
def advance(addresses, switches, ramped, q, t, target, h, work, relative, absolute, sensitive, counters):
    """Integrate from t to exactly `target`, starting with a step of at most h.

    With `ramped` the inputs `switches.u` change by `switches.slope`, and are those at `target` at the end.

    Returns (outcome, time reached, step to try next). The first of `work.k`, and with
    `sensitive` also that of `work.dk` and the Jacobian, belong to the state at the start and at the end.
    """
    n = work.n
    if n == 0:
        if ramped:
            for j in range(switches.inputs):
                switches.u[j] += (target - t) * switches.slope[j]
        return DONE, target, h
    # the Jacobian here belongs to the state: after a switch and after a sensitive step it has been evaluated
    # already
    fresh = sensitive
    for _ in range(_MOST_STEPS):
        left = target - t
        if left <= 0.0:
            return DONE, target, h
        step = min(h, left)
        # two equal steps rather than one and a crumb
        if step < left < 1.1 * step:
            step = 0.5 * left
        if not fresh:
            call_5(addresses[RHS_JACOBIAN], work.y, switches.u, q, work.value, work.jacobian)
            fresh = True
        set_weights(work, relative, absolute)
        # the error of the step is proportional to h³: the next h brings it to the tolerance, with nine tenths
        # for safety. Where Newton's iteration fails a shorter step helps it too, as the matrix is closer to
        # the identity
        outcome, error = attempt(addresses, switches, ramped, q, step, work)
        if not error <= 1.0:
            counters[REJECTED] += 1
            shorter = max(0.2, 0.9 * error ** (-1.0 / 3.0)) if outcome == CONVERGED else 0.25
            h = step * shorter
            if h <= _ROUNDING * max(abs(t), abs(target)):
                counters[GUILTY_STATE] = guilty_state(work, outcome)
                return NOT_FINITE_RHS if outcome == NOT_FINITE else STEP_TOO_SMALL, t, h
            continue
        counters[STEPS] += 1
        # only once the step is accepted: a rejected one costs no derivatives
        if sensitive:
            tangent(addresses, switches, ramped, q, step, work)
        else:
            fresh = False
        if ramped:
            for j in range(switches.inputs):
                switches.u[j] += step * switches.slope[j]
        for i in range(n):
            work.y[i] = work.z[3 * n + i]
            work.k[i] = work.k[3 * n + i]
        # exactly the target, on which samples and switches are compared
        t = target if step == left else t + step
        longer = min(5.0, max(0.3, 0.9 * error ** (-1.0 / 3.0))) if error > 0.0 else 5.0
        # a step cut short by the target says nothing against the longer one planned before
        h = max(step * longer, h) if step < h and longer >= 1.0 else step * longer
    return TOO_MANY_STEPS, t, h


@njit(**OPTIONS)
def guilty_state(work, outcome):
    """The state that kept the last attempt from succeeding."""
    guilty, worst = 0, -1.0
    for i in range(work.n):
        if outcome == NOT_FINITE:
            if not math.isfinite(work.value[i]):
                return i
        elif abs(work.correction[i]) > worst:
            guilty, worst = i, abs(work.correction[i])
    return guilty
