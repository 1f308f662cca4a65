"""The sizes of one integration, and of the two buffers it works in."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: places in the array of sizes: states, inputs, outputs, delays, sensitivity columns; entries of the three
#: packed ∂/∂q, and how many of those the columns use; commands that may wait at once; inputs that change
#: steadily between knots; how many of the last columns differentiate by what moves the commands' times
N, INPUTS, OUTPUTS_COUNT, DELAYS_COUNT, COLUMNS = range(5)
RHS_ENTRIES, OUTPUTS_ENTRIES, DELAYS_ENTRIES, RHS_ACTIVE, OUTPUTS_ACTIVE, DELAYS_ACTIVE, CAPACITY = range(
    5, 12
)
RAMPS, SHIFTS = 12, 13
SIZES = 14


def float_count(sizes: NDArray[np.int64]) -> int:
    """How many doubles the workspaces take, in the order in which `workspace.lay_out` cuts them."""
    n, inputs, outputs, delays, m, rhs, outputs_entries, delays_entries = (int(size) for size in sizes[:8])
    work = 14 * n + 2 * n * n + 7 * n * m + rhs
    switches = 5 * inputs + int(sizes[CAPACITY]) * (2 + m) + delays + delays * n + delays_entries + 2 * n
    return work + switches + outputs + outputs * n + outputs_entries


def integer_count(sizes: NDArray[np.int64]) -> int:
    """How many integers they take."""
    return int(sizes[N] + 1 + sizes[CAPACITY])


def stepping_places(sizes: NDArray[np.int64]) -> tuple[int, int, int]:
    """Where the state, the acting inputs and the commanded ones lie in the buffer of doubles."""
    n, m = int(sizes[N]), int(sizes[COLUMNS])
    acting = 14 * n + 2 * n * n + 7 * n * m + int(sizes[RHS_ENTRIES])
    return 0, acting, acting + int(sizes[INPUTS])
