"""The sizes of one integration, and of the two buffers it works in."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

#: places in the array of sizes: states, inputs, outputs, delays, sensitivity columns; entries of the three
#: packed ∂/∂q, and how many of those the columns use; commands that may wait at once; inputs that change
#: steadily between knots; how many of the last columns differentiate by what moves the commands' times;
#: words that stand behind each array, see `engine.guards`; arguments of splines, splines of each, and how
#: many entries of the three packed ∂/∂q they weigh
N, INPUTS, OUTPUTS_COUNT, DELAYS_COUNT, COLUMNS = range(5)
RHS_ENTRIES, OUTPUTS_ENTRIES, DELAYS_ENTRIES, RHS_ACTIVE, OUTPUTS_ACTIVE, DELAYS_ACTIVE, CAPACITY = range(
    5, 12
)
RAMPS, SHIFTS, GUARD = 12, 13, 14
SPLINE_ARGUMENTS, SPLINE_FUNCTIONS, RHS_SPLINES, OUTPUTS_SPLINES, DELAYS_SPLINES = range(15, 20)
SIZES = 20

#: words that describe an array: its address, then its length along each of up to three axes
WORDS = 4

#: readings that the kernel of variances takes at a time, so that what it makes of them stays in the nearest
#: cache, and how many sums it adds them to, beside one another
TILE, LANES = 256, 8

#: cubic splines: their degree, and the number of knots in excess of the functions
DEGREE, MORE_KNOTS = 3, 4


def float_regions(sizes: NDArray[np.int64]) -> list[tuple[str, int]]:
    """Name and length of each array of doubles, in the order in which `workspace.lay_out` cuts them."""
    n, inputs, outputs, delays, m, rhs, outputs_entries, delays_entries = (int(size) for size in sizes[:8])
    capacity = int(sizes[CAPACITY])
    return [
        ("y", n),
        ("k", 4 * n),
        ("z", 4 * n),
        ("base", n),
        ("value", n),
        ("correction", n),
        ("unit", n),
        ("weight", n),
        ("jacobian", n * n),
        ("matrix", n * n),
        ("reach and refusal", 2),
        ("s", n * m),
        ("dk", 4 * n * m),
        ("fixed", n * m),
        ("moving", n * m),
        ("packed", rhs),
        ("acting", inputs),
        ("commanded", inputs),
        ("following", inputs),
        ("waiting times", capacity),
        ("waiting values", capacity),
        ("shift", capacity * m),
        ("tau", delays),
        ("jacobian of delays", delays * n),
        ("packed of delays", delays_entries),
        ("earlier", n),
        ("later", n),
        ("slope", inputs),
        ("stage", inputs),
        ("outputs", outputs),
        ("jacobian of outputs", outputs * n),
        ("packed of outputs", outputs_entries),
        ("splines", int(sizes[SPLINE_ARGUMENTS] * sizes[SPLINE_FUNCTIONS])),
    ]


def integer_regions(sizes: NDArray[np.int64]) -> list[tuple[str, int]]:
    """Name and length of each array of integers."""
    return [
        ("exchanges", int(sizes[N])),
        ("exchanged", 1),
        ("waiting", 1),
        ("waiting inputs", int(sizes[CAPACITY])),
    ]


def float_count(sizes: NDArray[np.int64]) -> int:
    """Number of doubles in the workspaces."""
    return _float_count(sizes.tobytes())


@lru_cache(maxsize=256)
def _float_count(sizes: bytes) -> int:
    """`float_count` of sizes as bytes; cached, as the records of a problem have few different sizes."""
    array = np.frombuffer(sizes, dtype=np.int64)
    return sum(length + int(array[GUARD]) for _, length in float_regions(array))


def integer_count(sizes: NDArray[np.int64]) -> int:
    """Number of integers in the workspaces."""
    return sum(length + int(sizes[GUARD]) for _, length in integer_regions(sizes))


def stepping_places(sizes: NDArray[np.int64]) -> tuple[int, int, int]:
    """Offsets of the state, the acting inputs and the commanded inputs in the buffer of doubles."""
    indices, end = {}, 0
    for name, length in float_regions(sizes):
        indices[name] = end
        end += length + int(sizes[GUARD])
    return indices["y"], indices["acting"], indices["commanded"]
