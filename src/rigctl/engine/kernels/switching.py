"""Commands that act after a delay, and what a moved switch does to the sensitivities.

A command at time t for an input acts at ``t + tau``, tau = d(y(t), u_before, u_after, q). When tau depends
on a parameter, the state is continuous over the switch but its sensitivity jumps:

    s_after = s_before + (f_before - f_after)·dtau,    dtau = ∂d/∂q + ∂d/∂y·s(t)

P. I. Barton, C. K. Lee, Modeling, simulation, sensitivity analysis, and optimization of hybrid systems, ACM
TOMACS 12 (2002).

The time t of a command may itself be unknown: with its derivative dt by some quantity, the same jump holds
with dt in dtau's place, and a delay adds to it ``dtau = ∂d/∂q + ∂d/∂y·(s(t) + f_before·dt)``.
"""

from __future__ import annotations

import math

from numba import njit

from rigctl.engine.kernels.calling import (
    DELAYS,
    DELAYS_TANGENT,
    OPTIONS,
    RHS,
    call_4,
    call_5,
    call_7,
)
from rigctl.engine.kernels.outcomes import DONE, NOT_FINITE_DELAY, TOO_MANY_COMMANDS
from rigctl.engine.kernels.splines import evaluate_splines


@njit(**OPTIONS)
def next_switch(switches):
    """(time, place) of the waiting command that acts first; (inf, -1) when none waits."""
    earliest, index = math.inf, -1
    for k in range(switches.waiting[0]):
        if switches.time[k] < earliest:
            earliest, index = switches.time[k], k
    return earliest, index


@njit(**OPTIONS)
def drop(m, switches, index):
    """Take a command out of the queue, keeping the order of the others."""
    switches.waiting[0] -= 1
    for k in range(index, switches.waiting[0]):
        switches.time[k] = switches.time[k + 1]
        switches.value[k] = switches.value[k + 1]
        switches.index[k] = switches.index[k + 1]
        for c in range(m):
            switches.shift[k * m + c] = switches.shift[(k + 1) * m + c]


@njit(**OPTIONS)
def is_moved(moved, switches):
    """Whether the time of a command depends on anything: `moved` (shifts) are its derivatives."""
    largest = 0.0
    for c in range(switches.shifts):
        largest = max(largest, abs(moved[c]))
    return largest > 0.0


@njit(**OPTIONS)
def command(addresses, t, commanded, moved, q, work, switches, sensitive):
    """Take new commands at time t: inputs without a delay act now, the others are queued.

    An input whose command is NaN stays as it is: one that changes steadily takes no commands. `moved`
    (shifts) are the derivatives of t by the quantities of the last columns.
    Returns (outcome, whether an input changed).
    """
    changed = False
    late = False
    # f before anything changes: the jump of the sensitivity needs it on both sides
    jumps = sensitive and is_moved(moved, switches)
    if jumps:
        call_4(addresses[RHS], work.y, switches.u, q, switches.earlier)
    for j in range(switches.inputs):
        switches.following[j] = switches.commanded[j] if math.isnan(commanded[j]) else commanded[j]
        if switches.following[j] != switches.commanded[j]:
            is_late = False
            for d in range(switches.delays):
                is_late = is_late or switches.delayed[d] == j
            if is_late:
                late = True
            else:
                switches.u[j] = switches.following[j]
                changed = True
    if late:
        outcome = queue(addresses, t, moved, jumps, q, work, switches, sensitive)
        if outcome != DONE:
            return outcome, changed
    # s_after = s_before + (f_before - f_after)·dt, in the columns of what moves this command
    if jumps and changed:
        call_4(addresses[RHS], work.y, switches.u, q, switches.later)
        first = work.m - switches.shifts
        for i in range(work.n):
            jump = switches.earlier[i] - switches.later[i]
            for c in range(switches.shifts):
                work.s[i * work.m + first + c] += jump * moved[c]
    for j in range(switches.inputs):
        switches.commanded[j] = switches.following[j]
    return DONE, changed


@njit(**OPTIONS)
def queue(addresses, t, moved, jumps, q, work, switches, sensitive):
    """Put the delayed inputs that changed into the queue, each with its delay.

    With `jumps` the time t depends on something, and `switches.earlier` is f before the command.
    """
    if sensitive:
        call_7(
            addresses[DELAYS_TANGENT],
            work.y,
            switches.commanded,
            switches.following,
            q,
            switches.tau,
            switches.jacobian,
            switches.packed,
        )
    else:
        call_5(addresses[DELAYS], work.y, switches.commanded, switches.following, q, switches.tau)
    for d in range(switches.delays):
        j = switches.delayed[d]
        if switches.following[j] == switches.commanded[j]:
            continue
        tau = switches.tau[d]
        if not math.isfinite(tau):
            return NOT_FINITE_DELAY
        acts = t + max(tau, 0.0)
        # from the last one on, as the queue closes up behind what is dropped
        for k in range(switches.waiting[0] - 1, -1, -1):
            if switches.index[k] == j and switches.time[k] >= acts:
                drop(work.m, switches, k)
        index = switches.waiting[0]
        if index == switches.capacity:
            return TOO_MANY_COMMANDS
        switches.waiting[0] += 1
        switches.time[index] = acts
        switches.value[index] = switches.following[j]
        switches.index[index] = j
        for c in range(work.m):
            switches.shift[index * work.m + c] = 0.0
        # cut off at 0 a delay is constant, and has no derivative
        if sensitive and tau >= 0.0:
            set_shift(d, index, work, switches)
        if jumps:
            add_moved(d, index, moved, tau >= 0.0, work, switches)
    return DONE


@njit(**OPTIONS)
def add_moved(d, index, moved, late, work, switches):
    """The part of the shift due to the command's time: ``(1 + ∂d/∂y·f)·dt``, dt alone where d is cut off."""
    rate = 1.0
    if late:
        for i in range(work.n):
            rate += switches.jacobian[d * work.n + i] * switches.earlier[i]
    first = work.m - switches.shifts
    for c in range(switches.shifts):
        switches.shift[index * work.m + first + c] += rate * moved[c]


@njit(**OPTIONS)
def set_shift(d, index, work, switches):
    """``dtau = ∂d/∂q + ∂d/∂y·s`` of delay d, for every column."""
    n, m = work.n, work.m
    for i in range(n):
        slope = switches.jacobian[d * n + i]
        if slope != 0.0:
            for c in range(m):
                switches.shift[index * m + c] += slope * work.s[i * m + c]
    for entry in range(switches.used):
        source, row, column = (
            switches.active[3 * entry],
            switches.active[3 * entry + 1],
            switches.active[3 * entry + 2],
        )
        if row == d:
            switches.shift[index * m + column] += switches.packed[source]
    splines = work.splines
    if splines.delays_used:
        evaluate_splines(splines, n, switches.inputs, work.y, switches.commanded)
        for entry in range(splines.delays_used):
            if splines.delays[5 * entry + 1] == d:
                weight = splines.delays_scales[entry] * splines.basis[splines.delays[5 * entry + 3]]
                if splines.delays[5 * entry + 4] >= 0:
                    weight *= splines.basis[splines.delays[5 * entry + 4]]
                column = splines.delays[5 * entry + 2]
                switches.shift[index * m + column] += weight * switches.packed[splines.delays[5 * entry]]


@njit(**OPTIONS)
def act(addresses, index, q, work, switches, sensitive):
    """Let the waiting command at `index` act. Returns whether the input changed."""
    n, m = work.n, work.m
    j = switches.index[index]
    changed = switches.u[j] != switches.value[index]
    if changed:
        moved = False
        if sensitive:
            for c in range(m):
                moved = moved or switches.shift[index * m + c] != 0.0
        if moved:
            call_4(addresses[RHS], work.y, switches.u, q, switches.earlier)
        switches.u[j] = switches.value[index]
        # the delay moves this moment by dtau: s_after = s_before + (f_before - f_after)·dtau
        if moved:
            call_4(addresses[RHS], work.y, switches.u, q, switches.later)
            for i in range(n):
                jump = switches.earlier[i] - switches.later[i]
                for c in range(m):
                    work.s[i * m + c] += jump * switches.shift[index * m + c]
    drop(m, switches, index)
    return changed
