"""One stretch of a bench that is stepped sample by sample."""

from __future__ import annotations

from rigctl.engine.kernels.advance import advance, restart
from rigctl.engine.kernels.calling import (
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


def step_to(words):
    """Command the inputs now, then integrate to `target`; the buffers and `carried` hold all between calls.

    Fills `outputs` with g at `target`. `words` describe the arrays (see
    `sizes.WORDS`); `returned` with the outcome and the time reached.
    """
    addresses = integers_1(words, 0)
    sizes = integers_1(words, 1)
    tolerance = floats_1(words, 2)
    q = floats_1(words, 3)
    target = floats_1(words, 4)[0]
    commanded = floats_1(words, 5)
    carried = floats_1(words, 6)
    delayed = integers_1(words, 7)
    floats = floats_1(words, 8)
    integers = integers_1(words, 9)
    outputs = floats_1(words, 10)
    counters = integers_1(words, 11)
    returned = floats_1(words, 12)
    # no columns and no splines: a bench that is stepped needs no derivatives, and places that nothing reads
    # may point anywhere
    nothing, buffer = pointer_to(integers), pointer_to(floats)
    no_splines = (buffer, buffer, nothing, buffer, nothing, buffer, nothing, buffer)
    work, switches, _ = lay_out(
        sizes, buffer, nothing, nothing, nothing, nothing, pointer_to(delayed), no_splines
    )
    functions, parameters = pointer_to(addresses), pointer_to(q)
    relative, absolute = tolerance[0], offset(pointer_to(tolerance), 1)
    t, h, stale = carried[TIME], carried[NEXT_STEP], carried[STALE] != 0.0
    # the commands first, at the present time; then from one waiting command to the next, and to the target
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
    # also after a failure, with the state that was reached
    call_4(functions[OUTPUTS], work.y, switches.u, parameters, pointer_to(outputs))
    carried[TIME], carried[NEXT_STEP], carried[STALE] = t, h, 1.0 if stale else 0.0
    returned[0] = outcome
    returned[1] = t
