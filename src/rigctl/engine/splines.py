"""Columns for the shape of a term: derivatives of the readings if the term is weighted by a spline.

    f = … + (1 + Σ_k b_k·B_k(x))·T(y, u, q),   x = w·(y, u),   columns ∂z/∂b_k at b = 0

B_k are cubic B-splines (C. de Boor, A Practical Guide to Splines, 1978). A term is identified by the
parameters in it: if T is proportional to a, ``T = a·∂f/∂a``; if a parameter is not a factor, the spline
weights the parameter itself. Any term of a compiled system can be treated in this way, without compiling
another system.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.engine.kernels.sizes import DEGREE, MORE_KNOTS
from rigctl.engine.source import Pattern
from rigctl.engine.system import System
from rigctl.errors import RigctlError, unknown_name

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True)
class SplineArgument:
    """The argument of a spline.

    Attributes
    ----------
    weights: of states and inputs by name: ``x = Σ weight·variable``.
    knots: (functions + 4) increasing, in the unit of x; x is clamped to the fourth knot from either end.
    """

    weights: Mapping[str, float]
    knots: Floats


@dataclass(frozen=True)
class SplineColumn:
    """One column.

    Attributes
    ----------
    parameters: those that identify the term, each with a factor: the value to which the term is proportional.
    first: (argument, function) of the spline that weights it; `second` of another that multiplies the first.
    """

    parameters: Mapping[str, float]
    first: tuple[int, int]
    second: tuple[int, int] | None = None


@dataclass(frozen=True)
class SplineColumns:
    """Columns for shapes, with the same number of functions for each argument.

    Raises
    ------
    RigctlError
        knots do not increase, or a column refers to a function that does not exist.
    """

    arguments: tuple[SplineArgument, ...] = ()
    columns: tuple[SplineColumn, ...] = ()

    def __post_init__(self) -> None:
        sizes = {one.knots.size for one in self.arguments}
        problem = ""
        if len(sizes) > 1:
            problem = "all arguments need as many knots"
        elif any(one.knots.size < 2 * MORE_KNOTS for one in self.arguments):
            problem = f"a cubic spline needs {2 * MORE_KNOTS} knots"
        elif any(not np.all(np.diff(one.knots) > 0.0) for one in self.arguments):
            problem = "the knots do not rise"
        else:
            indices = [
                index for one in self.columns for index in (one.first, one.second) if index is not None
            ]
            if any(not (0 <= a < len(self.arguments) and 0 <= k < self.functions) for a, k in indices):
                problem = "a column asks for a function that there is not"
        if problem:
            raise RigctlError(f"columns by shapes: {problem}")

    @property
    def functions(self) -> int:
        """Number of splines of each argument."""
        return self.arguments[0].knots.size - MORE_KNOTS if self.arguments else 0

    def weights(self, system: System) -> Floats:
        """(arguments, states + inputs), in the form required by the kernels."""
        names = [*system.state_names, *system.input_names]
        result = np.zeros((len(self.arguments), len(names)))
        for index, argument in enumerate(self.arguments):
            for name, weight in argument.weights.items():
                if name not in names:
                    raise unknown_name("state or input of a spline", name, names)
                result[index, names.index(name)] = weight
        return result

    def knots(self) -> Floats:
        """(arguments, functions + 4)."""
        if not self.arguments:
            return np.empty((0, 0))
        return np.array([one.knots for one in self.arguments], dtype=float)

    def active(self, pattern: Pattern, system: System, first: int) -> tuple[Integers, Floats]:
        """The entries of a packed ∂/∂q that the columns use; `first` is the index of the first column.

        Returns
        -------
        (entries, 5) index in the packed array, row, column, function and second function (−1 for none); and
        (entries) the factor of each.
        """
        # by parameter, as a term appears in every row in which its parameter does
        indices: dict[int, list[tuple[int, int]]] = {}
        for index, (row, parameter) in enumerate(pattern):
            indices.setdefault(parameter, []).append((index, row))
        known = system.parameter_names
        entries: list[tuple[int, ...]] = []
        scales: list[float] = []
        for column, one in enumerate(self.columns):
            function = one.first[0] * self.functions + one.first[1]
            second = -1 if one.second is None else one.second[0] * self.functions + one.second[1]
            for name, scale in one.parameters.items():
                if name not in known:
                    raise unknown_name("parameter that carries a term", name, known)
                for index, row in indices.get(known.index(name), ()):
                    entries.append((index, row, first + column, function, second))
                    scales.append(scale)
        return np.array(entries, dtype=np.int64).reshape(-1, 5), np.array(scales, dtype=np.float64)


#: no columns for shapes
NO_SPLINES = SplineColumns()


def knots_over(low: float, high: float, functions: int, inner: Sequence[float] = ()) -> Floats:
    """(functions + 4) knots of cubic splines over a range: `inner` ones (functions − 4), else evenly spaced.

    The knots continue beyond the ends with the spacing of the outermost interval, so that the functions sum
    to 1 inside.
    """
    # three further knots beyond each end, as a cubic function spans four intervals
    breaks = np.array([low, *inner, high]) if len(inner) else np.linspace(low, high, functions - DEGREE + 1)
    before = breaks[0] - (breaks[1] - breaks[0]) * np.arange(DEGREE, 0, -1)
    behind = breaks[-1] + (breaks[-1] - breaks[-2]) * np.arange(1, DEGREE + 1)
    return np.concatenate([before, breaks, behind])
