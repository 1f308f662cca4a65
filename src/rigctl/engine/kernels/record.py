"""One record: from its first command to its last sample, over every switch.

The integration goes from event to event: a sample, a command, a knot of a ramp, or something that acts by
itself, such as a delayed command. At one moment there may be several, and their order is fixed:

1. samples, which show what was before the switch,
2. knots, which change the slope of an input,
3. what waited for this moment, then the commands of it (`settle`),
4. where an input has jumped, a restart: the derivatives before it say nothing about those after it.

Then `advance` integrates to the next event, exactly: nothing is interpolated.
"""

from __future__ import annotations

import math

from numba import njit

from rigctl.engine.kernels.advance import advance, restart
from rigctl.engine.kernels.calling import (
    OPTIONS,
    OUTPUTS,
    OUTPUTS_TANGENT,
    call_4,
    call_6,
    floats_1,
    floats_2,
    floats_3,
    integers_1,
    integers_2,
    offset,
    pointer_to,
)
from rigctl.engine.kernels.outcomes import DONE
from rigctl.engine.kernels.splines import add_splines, evaluate_splines
from rigctl.engine.kernels.switching import act, command, next_switch
from rigctl.engine.kernels.workspace import lay_out


@njit(**OPTIONS)
def differentiate_outputs(addresses, u, q, inputs, work, seen, result):
    """``∂g/∂y·s + ∂g/∂q`` into `result` (outputs, columns)."""
    n, m = work.n, work.m
    call_6(addresses[OUTPUTS_TANGENT], work.y, u, q, seen.value, seen.jacobian, seen.packed)
    # ∂g/∂y·s, then ∂g/∂q for the columns of parameters, then the terms that splines weigh
    for row in range(seen.outputs):
        for c in range(m):
            result[row * m + c] = 0.0
        for i in range(n):
            slope = seen.jacobian[row * n + i]
            if slope != 0.0:
                for c in range(m):
                    result[row * m + c] += slope * work.s[i * m + c]
    for entry in range(seen.used):
        index, row, column = seen.active[3 * entry], seen.active[3 * entry + 1], seen.active[3 * entry + 2]
        result[row * m + column] += seen.packed[index]
    splines = work.splines
    if splines.outputs_used:
        evaluate_splines(splines, n, inputs, work.y, u)
        add_splines(
            splines,
            splines.outputs,
            splines.outputs_scales,
            splines.outputs_used,
            seen.packed,
            m,
            1.0,
            result,
        )


@njit(**OPTIONS)
def settle(addresses, t, commands, count, times, values, shifts, q, work, switches, sensitive):
    """Let everything act that is due at time t: first what waited, then the commands of this moment.

    `count` commands: `values` (count, inputs) from `times` (count) on, the first `commands` of them taken;
    `shifts` (count, switches.shifts) the derivatives of these times.
    Returns (outcome, commands taken so far, whether an input changed, when the next one acts by itself).
    """
    stale = False
    while True:
        switch_time, index = next_switch(switches)
        if switch_time <= t:
            stale = act(addresses, index, q, work, switches, sensitive) or stale
        elif commands < count and times[commands] <= t:
            commanded = offset(values, commands * switches.inputs)
            moved = offset(shifts, commands * switches.shifts)
            outcome, changed = command(addresses, t, commanded, moved, q, work, switches, sensitive)
            if outcome != DONE:
                return outcome, commands, stale, switch_time
            stale = stale or changed
            commands += 1
        else:
            return DONE, commands, stale, switch_time


@njit(**OPTIONS)
def set_ramps(t, knot, knots, ramps, ramped, switches):
    """The inputs that change steadily, at time t, and their slopes; `knot` is the first one after t.

    Before the first knot and after the last one they are constant.
    """
    last = knots.size - 1
    for r in range(ramped.size):
        j = ramped[r]
        if knot == 0 or knot > last:
            switches.u[j] = ramps[0 if knot == 0 else last, r]
            switches.slope[j] = 0.0
        else:
            begun, ends = knots[knot - 1], knots[knot]
            # set anew at each knot, so that rounding does not add up over a record
            slope = (ramps[knot, r] - ramps[knot - 1, r]) / (ends - begun)
            switches.u[j] = ramps[knot - 1, r] + (t - begun) * slope
            switches.slope[j] = slope
        switches.commanded[j] = switches.u[j]


@njit(**OPTIONS)
def ended(returned, outcome, t, samples):
    """Say how the integration ended."""
    returned[0] = outcome
    returned[1] = t
    returned[2] = samples


def integrate_record(words):
    """Integrate from ``command_times[0]`` over all samples; a sample at a switch shows what was before it.

    `words` describe the arrays, see `sizes.WORDS`: `sizes` and the buffers, full of zeros, as in `workspace`;
    `tolerance` the relative one and then the absolute one of each state; y0 (n); q; command k holds
    ``command_values[k]`` from ``command_times[k]`` on, whose derivatives by the quantities of the last
    columns are ``command_shifts[k]``; the inputs `ramped` (r) are straight lines between their values `ramps`
    (knots, r) at the times `knots`, and constant beyond; `initial_columns` the initial states that the
    columns before the last differentiate by; the tables of splines as in `workspace`. Fills states
    (samples, n), outputs (samples, z) and sensitivities (samples, z, columns), and `returned` with the
    outcome, the time reached and the samples done.

    It unpacks its words itself: a second function that did would make it take a sixth longer to compile.
    """
    addresses = integers_1(words, 0)
    sizes = integers_1(words, 1)
    tolerance = floats_1(words, 2)
    y0 = floats_1(words, 3)
    q = floats_1(words, 4)
    command_times = floats_1(words, 5)
    command_values = floats_2(words, 6)
    command_shifts = floats_2(words, 7)
    knots = floats_1(words, 8)
    ramps = floats_2(words, 9)
    ramped = integers_1(words, 10)
    sample_times = floats_1(words, 11)
    initial_columns = integers_1(words, 12)
    delayed = integers_1(words, 13)
    rhs_active = integers_2(words, 14)
    outputs_active = integers_2(words, 15)
    delays_active = integers_2(words, 16)
    spline_weights = floats_2(words, 17)
    spline_knots = floats_2(words, 18)
    rhs_splines = integers_2(words, 19)
    rhs_scales = floats_1(words, 20)
    outputs_splines = integers_2(words, 21)
    outputs_scales = floats_1(words, 22)
    delays_splines = integers_2(words, 23)
    delays_scales = floats_1(words, 24)
    floats = floats_1(words, 25)
    integers = integers_1(words, 26)
    states = floats_2(words, 27)
    outputs = floats_2(words, 28)
    sensitivities = floats_3(words, 29)
    counters = integers_1(words, 30)
    returned = floats_1(words, 31)
    work, switches, seen = lay_out(
        sizes,
        pointer_to(floats),
        pointer_to(integers),
        pointer_to(rhs_active),
        pointer_to(outputs_active),
        pointer_to(delays_active),
        pointer_to(delayed),
        (
            pointer_to(spline_weights),
            pointer_to(spline_knots),
            pointer_to(rhs_splines),
            pointer_to(rhs_scales),
            pointer_to(outputs_splines),
            pointer_to(outputs_scales),
            pointer_to(delays_splines),
            pointer_to(delays_scales),
        ),
    )
    n, m, functions, parameters = work.n, work.m, pointer_to(addresses), pointer_to(q)
    count, times, values = command_times.size, pointer_to(command_times), pointer_to(command_values)
    shifts = pointer_to(command_shifts)
    sensitive = m > 0
    relative, absolute = tolerance[0], offset(pointer_to(tolerance), 1)
    for i in range(n):
        work.y[i] = y0[i]
    switches.waiting[0] = 0
    for j in range(switches.inputs):
        switches.u[j] = command_values[0, j]
        switches.commanded[j] = command_values[0, j]
    first = m - switches.shifts - initial_columns.size
    for c in range(initial_columns.size):
        work.s[initial_columns[c] * m + first + c] = 1.0

    # from event to event. At each one, in this order: samples are taken with what was before it, knots and
    # commands change the inputs, and only if one did the integration begins anew. Between two events it goes
    # on with its step and its derivatives
    t, h, stale, commands, samples = command_times[0], 0.0, True, 1, 0
    knot = 0
    while knot < knots.size and knots[knot] <= t:
        knot += 1
    set_ramps(t, knot, knots, ramps, ramped, switches)
    while True:
        while samples < sample_times.size and sample_times[samples] <= t:
            for i in range(n):
                states[samples, i] = work.y[i]
            shown = offset(pointer_to(outputs), samples * seen.outputs)
            call_4(functions[OUTPUTS], work.y, switches.u, parameters, shown)
            if sensitive:
                shown = offset(pointer_to(sensitivities), samples * seen.outputs * m)
                differentiate_outputs(functions, switches.u, parameters, switches.inputs, work, seen, shown)
            samples += 1
        if samples == sample_times.size:
            return ended(returned, DONE, t, samples)
        if knot < knots.size and knots[knot] <= t:
            knot += 1
            set_ramps(t, knot, knots, ramps, ramped, switches)
        outcome, commands, changed, switch_time = settle(
            functions, t, commands, count, times, values, shifts, parameters, work, switches, sensitive
        )
        if outcome == DONE and (changed or stale):
            outcome, h = restart(
                functions,
                switches.u,
                parameters,
                switches.inputs,
                work,
                relative,
                absolute,
                sensitive,
                counters,
            )
            stale = False
        if outcome != DONE:
            return ended(returned, outcome, t, samples)
        # to whatever comes first. Every sample is the end of a step: nothing is interpolated, and so the
        # derivatives are those of the readings themselves
        following = times[commands] if commands < count else math.inf
        target = min(sample_times[samples], following, switch_time)
        if knot < knots.size:
            target = min(target, knots[knot])
        # along a line the derivative of the state is continuous, so that a knot is no restart
        steadily = 0 < knot < knots.size
        outcome, t, h = advance(
            functions,
            switches,
            steadily,
            parameters,
            t,
            target,
            h,
            work,
            relative,
            absolute,
            sensitive,
            counters,
        )
        if outcome != DONE:
            return ended(returned, outcome, t, samples)
