"""Bounds checks of the kernels: marker words around every array that they use.

The kernels and the machine code of a model write through plain pointers, without checks. With
``RIGCTL_DEBUG=1`` every array of a workspace, and every result, is followed by markers; a changed marker
shows which array was overrun. Markers are NaN, so that reading past an end does not yield a valid number.
Arrays that the kernels index are then checked by the compiler. It costs a few per cent of time.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from rigctl.engine.kernels import sizes as sizing
from rigctl.errors import ExitCode, RigctlError

#: environment variable that enables the checks
DEBUG_VARIABLE = "RIGCTL_DEBUG"

#: number of marker words behind each array
_WIDTH = 4
#: a NaN that no operation produces
_MARK = 0x7FF8_DEAD_BEEF_CAFE

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


def width() -> int:
    """Number of marker words behind each array: none unless ``RIGCTL_DEBUG`` is set."""
    return _WIDTH if os.environ.get(DEBUG_VARIABLE, "") not in ("", "0") else 0


class Workspace:
    """The two buffers of one integration, zero except for the markers.

    Attributes
    ----------
    floats, integers: the buffers, as `kernels.workspace` lays them out.
    """

    def __init__(self, sizes: Integers) -> None:
        self._sizes = sizes
        self.floats = np.zeros(sizing.float_count(sizes))
        self.integers = np.zeros(sizing.integer_count(sizes), dtype=np.int64)
        for _, marks in self._marks():
            marks[:] = _MARK

    def check(self) -> None:
        """Require that no array was overrun.

        Raises
        ------
        RigctlError
            one was; the message names it.
        """
        for name, marks in self._marks():
            _require(name, marks)

    def _marks(self) -> Iterator[tuple[str, Integers]]:
        guard = int(self._sizes[sizing.GUARD])
        if not guard:
            return
        for buffer, regions in (
            (self.floats.view(np.int64), sizing.float_regions(self._sizes)),
            (self.integers, sizing.integer_regions(self._sizes)),
        ):
            end = 0
            for name, length in regions:
                end += length + guard
                yield name, buffer[end - guard : end]


class Result:
    """An array to be filled by a kernel, with markers on both sides if the checks are enabled."""

    def __init__(self, name: str, shape: Sequence[int]) -> None:
        self._name = name
        guard = width()
        size = math.prod(shape)
        buffer = np.empty(size + 2 * guard)
        self._marks: tuple[Integers, ...] = ()
        if guard:
            self._marks = buffer.view(np.int64)[:guard], buffer.view(np.int64)[size + guard :]
            for marks in self._marks:
                marks[:] = _MARK
        self.values: Floats = buffer[guard : size + guard].reshape(shape)

    def check(self) -> None:
        """As `Workspace.check`."""
        for marks in self._marks:
            _require(self._name, marks)


def _require(name: str, marks: Integers) -> None:
    if np.any(marks != _MARK):
        raise RigctlError(f"a kernel wrote past the array '{name}'", exit_code=ExitCode.FAILED)
