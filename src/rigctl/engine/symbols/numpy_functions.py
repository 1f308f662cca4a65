"""numpy's functions, called with symbols: ``np.sqrt(x)`` of an expression is an expression."""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np

from rigctl.engine.symbols.functions import cos, exp, log, power, sin, sqrt, tanh
from rigctl.errors import RigctlError

#: what each of numpy's functions is in symbols
_IN_SYMBOLS: Mapping[str, Callable[..., Any]] = MappingProxyType(
    {
        "add": operator.add,
        "subtract": operator.sub,
        "multiply": operator.mul,
        "divide": operator.truediv,
        "negative": operator.neg,
        "positive": operator.pos,
        "power": power,
        "square": lambda x: x * x,
        "reciprocal": lambda x: 1.0 / x,
        "exp": exp,
        "log": log,
        "sqrt": sqrt,
        "tanh": tanh,
        "sin": sin,
        "cos": cos,
        "tan": lambda x: sin(x) / cos(x),
        "sinh": lambda x: 0.5 * (exp(x) - exp(-x)),
        "cosh": lambda x: 0.5 * (exp(x) + exp(-x)),
        "hypot": lambda x, y: sqrt(x * x + y * y),
    }
)
#: those that have a corner or a jump
_NOT_SMOOTH = frozenset(
    {"absolute", "fabs", "sign", "heaviside", "maximum", "minimum", "fmax", "fmin", "floor", "ceil", "rint"}
    | {"greater", "less", "greater_equal", "less_equal", "equal", "not_equal"}
)


def of_symbols(ufunc: Any, method: str, inputs: Sequence[Any], options: Mapping[str, Any]) -> Any:
    """The expression that one of numpy's functions gives; of an array, an array of expressions.

    Raises
    ------
    RigctlError
        it has no equation in symbols, or no derivative.
    """
    name = ufunc.__name__
    if name in _NOT_SMOOTH:
        raise RigctlError(
            f"an equation may not have the corners of numpy.{name}",
            hint="use a smooth switch of rigctl.engine.symbols: positive_part, absolute, minimum, maximum, "
            "smooth_step or tanh",
        )
    if name not in _IN_SYMBOLS or method != "__call__" or options:
        raise RigctlError(f"numpy.{name} takes no symbols", expected=f"one of {', '.join(_IN_SYMBOLS)}")
    arrays = [one for one in inputs if isinstance(one, np.ndarray) and one.ndim]
    if arrays:
        each = np.frompyfunc(_IN_SYMBOLS[name], len(inputs), 1)
        return each(*(one if isinstance(one, np.ndarray) else _boxed(one) for one in inputs))
    return _IN_SYMBOLS[name](
        *(one.item() if isinstance(one, np.generic | np.ndarray) else one for one in inputs)
    )


def _boxed(value: Any) -> Any:
    """An array of no dimensions, so that numpy does not ask the symbol itself."""
    box = np.empty((), dtype=object)
    box[()] = value
    return box
