"""One stretch of a bench that is stepped sample by sample."""

from __future__ import annotations

from numba import njit

from rigctl.engine.kernels.advance import advance, restart
from rigctl.engine.kernels.calling import (
    OPTIONS,
    OUTPUTS,
    call_4,
    floats_1,
    integers_1,
    offset,
    pointer_to,
)
from rigctl.engine.kernels.outcomes import DONE
from rigctl.engine.kernels.switching import act, command, next_switch
from rigctl.engine.kernels.workspace import lay_out

#: places in the array of what is carried from call to call
TIME, NEXT_STEP, STALE = range(3)


@njit(**OPTIONS)
def step_to(
    addresses, sizes, tolerance, q, target, commanded, carried, delayed, floats, integers, outputs, counters
):
    """Command the inputs now, then integrate to `target`; the buffers and `carried` hold all between calls.

    Fills `outputs` with g at `target`. Returns (outcome, time reached).
    """
    nothing, buffer = pointer_to(integers), pointer_to(floats)
    no_splines = (buffer, buffer, nothing, buffer, nothing, buffer, nothing, buffer)
    work, switches, _ = lay_out(
        sizes, buffer, nothing, nothing, nothing, nothing, pointer_to(delayed), no_splines
    )
    functions, parameters = pointer_to(addresses), pointer_to(q)
    relative, absolute = tolerance[0], offset(pointer_to(tolerance), 1)
    t, h, stale = carried[TIME], carried[NEXT_STEP], carried[STALE] != 0.0
    outcome, changed = command(
        functions, t, pointer_to(commanded), switches.stage, parameters, work, switches, False
    )
    stale = stale or changed
    while outcome == DONE:
        switch_time, index = next_switch(switches)
        while switch_time <= t:
            stale = act(functions, index, parameters, work, switches, False) or stale
            switch_time, index = next_switch(switches)
        if t >= target:
            break
        if stale:
            outcome, h = restart(
                functions, switches.u, parameters, switches.inputs, work, relative, absolute, False, counters
            )
            stale = False
        if outcome == DONE:
            outcome, t, h = advance(
                functions,
                switches,
                False,
                parameters,
                t,
                min(target, switch_time),
                h,
                work,
                relative,
                absolute,
                False,
                counters,
            )
    call_4(functions[OUTPUTS], work.y, switches.u, parameters, pointer_to(outputs))
    carried[TIME], carried[NEXT_STEP], carried[STALE] = t, h, 1.0 if stale else 0.0
    return outcome, t


def from_words(words):
    """`step_to` of the arrays that `words` describe, see `sizes.WORDS`; the last one is filled with what it
    returns."""
    outcome, reached = step_to(
        integers_1(words, 0),  # addresses
        integers_1(words, 1),  # sizes
        floats_1(words, 2),  # tolerance
        floats_1(words, 3),  # q
        floats_1(words, 4)[0],  # target
        floats_1(words, 5),  # commanded
        floats_1(words, 6),  # carried
        integers_1(words, 7),  # delayed
        floats_1(words, 8),  # floats
        integers_1(words, 9),  # integers
        floats_1(words, 10),  # outputs
        integers_1(words, 11),  # counters
    )
    returned = floats_1(words, 12)
    returned[0] = outcome
    returned[1] = reached
