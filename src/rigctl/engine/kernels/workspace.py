"""Memory layout of one integration: pointers into two buffers that the caller allocates."""

from __future__ import annotations

from collections import namedtuple

from numba import njit

from rigctl.engine.kernels.calling import OPTIONS, offset
from rigctl.engine.kernels.sizes import (
    CAPACITY,
    COLUMNS,
    DELAYS_ACTIVE,
    DELAYS_COUNT,
    DELAYS_ENTRIES,
    DELAYS_SPLINES,
    GUARD,
    INPUTS,
    OUTPUTS_ACTIVE,
    OUTPUTS_COUNT,
    OUTPUTS_ENTRIES,
    OUTPUTS_SPLINES,
    RHS_ACTIVE,
    RHS_ENTRIES,
    RHS_SPLINES,
    SHIFTS,
    SPLINE_ARGUMENTS,
    SPLINE_FUNCTIONS,
    N,
)

#: y the state (n); k stage derivatives (4, n); z stage values (4, n); base, value, correction (n);
#: unit the tolerance of each state here and weight its inverse (n);
#: jacobian, matrix (n, n); reach (2) h·gamma and whether the elimination in order was refused; exchanges (n)
#: of its rows and exchanged (1) whether there are any;
#: s state sensitivities (n, m); dk their stage derivatives (4, n, m); fixed, moving (n, m);
#: packed ∂f/∂q; active (used, 3): place in `packed`, row, column; splines as below
Work = namedtuple(  # noqa: PYI024 - numba compiles this kind
    "Work",
    "n m y k z base value correction unit weight jacobian matrix reach exchanges exchanged s dk fixed moving "
    "packed active used splines",
)

#: weights (arguments, n + inputs); knots (arguments, functions + 4); basis (arguments, functions) the values;
#: of each packed ∂/∂q the entries (used, 5) that are weighed, and their scales: see `kernels.splines`
Splines = namedtuple(  # noqa: PYI024 - numba compiles this kind
    "Splines",
    "arguments functions weights knots basis rhs rhs_scales rhs_used outputs outputs_scales outputs_used "
    "delays delays_scales delays_used",
)

#: u the inputs that act now, commanded the last ones commanded, following those being commanded, slope
#: du/dt of those that change steadily, stage their values inside a step (inputs);
#: waiting (1) how many commands wait, and of each the time it acts, its value, index of its input and
#: shift dtau (m); delayed the input of each delay;
#: tau, jacobian, packed what the delays' functions return; active (used, 3) as above;
#: earlier, later f on both sides of a switch (n); shifts how many of the last columns move command times
Switches = namedtuple(  # noqa: PYI024 - numba compiles this kind
    "Switches",
    "inputs delays u commanded following waiting time value index shift delayed tau jacobian packed active "
    "used capacity earlier later slope stage shifts",
)

#: value g (outputs); jacobian (outputs, n); packed ∂g/∂q; active (used, 3) as above
Seen = namedtuple("Seen", "outputs value jacobian packed active used")  # noqa: PYI024


@njit(**OPTIONS)
def lay_out(sizes, floats, integers, rhs_active, outputs_active, delays_active, delayed, spline_tables):
    """The three workspaces inside the buffers `floats` and `integers`, cut as `sizes.float_regions` says.

    `spline_tables` are the tables of `Splines`: weights, knots, then entries and scales of each packed ∂/∂q.
    """
    n, m, inputs, delays = sizes[N], sizes[COLUMNS], sizes[INPUTS], sizes[DELAYS_COUNT]
    capacity, outputs, guard = sizes[CAPACITY], sizes[OUTPUTS_COUNT], sizes[GUARD]
    # in the order of `sizes.float_regions`, which allocates and guards what is cut here
    y = floats
    k = offset(y, n + guard)
    z = offset(k, 4 * n + guard)
    base = offset(z, 4 * n + guard)
    value = offset(base, n + guard)
    correction = offset(value, n + guard)
    unit = offset(correction, n + guard)
    weight = offset(unit, n + guard)
    jacobian = offset(weight, n + guard)
    matrix = offset(jacobian, n * n + guard)
    reach = offset(matrix, n * n + guard)
    s = offset(reach, 2 + guard)
    dk = offset(s, n * m + guard)
    fixed = offset(dk, 4 * n * m + guard)
    moving = offset(fixed, n * m + guard)
    packed = offset(moving, n * m + guard)
    u = offset(packed, sizes[RHS_ENTRIES] + guard)
    commanded = offset(u, inputs + guard)
    following = offset(commanded, inputs + guard)
    time = offset(following, inputs + guard)
    held = offset(time, capacity + guard)
    shift = offset(held, capacity + guard)
    tau = offset(shift, capacity * m + guard)
    delay_jacobian = offset(tau, delays + guard)
    delay_packed = offset(delay_jacobian, delays * n + guard)
    earlier = offset(delay_packed, sizes[DELAYS_ENTRIES] + guard)
    later = offset(earlier, n + guard)
    slope = offset(later, n + guard)
    stage = offset(slope, inputs + guard)
    exchanged = offset(integers, n + guard)
    waiting = offset(exchanged, 1 + guard)
    switches = Switches(
        inputs, delays, u, commanded, following, waiting, time, held, offset(waiting, 1 + guard), shift,
        delayed, tau, delay_jacobian, delay_packed, delays_active, sizes[DELAYS_ACTIVE], capacity, earlier,
        later, slope, stage, sizes[SHIFTS],
    )  # fmt: skip
    seen_value = offset(stage, inputs + guard)
    seen_jacobian = offset(seen_value, outputs + guard)
    seen_packed = offset(seen_jacobian, outputs * n + guard)
    basis = offset(seen_packed, sizes[OUTPUTS_ENTRIES] + guard)
    weights, knots, rhs, rhs_scales, read, read_scales, late, late_scales = spline_tables
    splines = Splines(
        sizes[SPLINE_ARGUMENTS], sizes[SPLINE_FUNCTIONS], weights, knots, basis, rhs, rhs_scales,
        sizes[RHS_SPLINES], read, read_scales, sizes[OUTPUTS_SPLINES], late, late_scales,
        sizes[DELAYS_SPLINES],
    )  # fmt: skip
    work = Work(
        n, m, y, k, z, base, value, correction, unit, weight, jacobian, matrix, reach, integers, exchanged,
        s, dk, fixed, moving, packed, rhs_active, sizes[RHS_ACTIVE], splines,
    )  # fmt: skip
    seen = Seen(outputs, seen_value, seen_jacobian, seen_packed, outputs_active, sizes[OUTPUTS_ACTIVE])
    return work, switches, seen
