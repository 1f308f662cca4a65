"""Functions for equations; each takes expressions or plain numbers, so that a term can be tested by itself.

Arrays of numbers work too, element by element, for tables and curves.

The solver requires smooth equations. Instead of an ``if``, one of the smooth switches defined here is used;
each has a width, the distance from the corner within which it is rounded. A width given as a plain number is
in the SI unit of the quantity that it rounds.
"""

from __future__ import annotations

import math
from typing import Any, overload

from rigctl.engine.symbols.dimension import dimension_of
from rigctl.engine.symbols.expr import Expr, Scalar
from rigctl.errors import RigctlError


@overload
def exp(x: Expr) -> Expr: ...
@overload
def exp(x: float) -> float: ...
@overload
def exp(x: Scalar) -> Scalar: ...
def exp(x: Any) -> Any:
    """``e ** x`` of a dimensionless x; infinite beyond the range of a double."""
    if isinstance(x, Expr):
        return x.graph.function("exp", x)
    if not isinstance(x, int | float):
        return _elementwise("exp", x)
    try:
        return math.exp(x)
    except OverflowError:
        return math.inf


@overload
def log(x: Expr) -> Expr: ...
@overload
def log(x: float) -> float: ...
@overload
def log(x: Scalar) -> Scalar: ...
def log(x: Any) -> Any:
    """The natural logarithm of a dimensionless x; of a plain number that is not positive: nan or -inf."""
    if isinstance(x, Expr):
        return x.graph.function("log", x)
    if not isinstance(x, int | float):
        return _elementwise("log", x)
    if x > 0.0:
        return math.log(x)
    return -math.inf if x == 0.0 else math.nan


@overload
def sqrt(x: Expr) -> Expr: ...
@overload
def sqrt(x: float) -> float: ...
@overload
def sqrt(x: Scalar) -> Scalar: ...
def sqrt(x: Any) -> Any:
    """The square root; of a plain negative number nan. Its slope at 0 is infinite: see `absolute`."""
    if isinstance(x, Expr):
        return x.graph.function("sqrt", x)
    if not isinstance(x, int | float):
        return _elementwise("sqrt", x)
    return math.sqrt(x) if x >= 0.0 else math.nan


@overload
def tanh(x: Expr) -> Expr: ...
@overload
def tanh(x: float) -> float: ...
@overload
def tanh(x: Scalar) -> Scalar: ...
def tanh(x: Any) -> Any:
    """The hyperbolic tangent of a dimensionless x: a smooth sign."""
    if isinstance(x, Expr):
        return x.graph.function("tanh", x)
    return math.tanh(x) if isinstance(x, int | float) else _elementwise("tanh", x)


@overload
def sin(x: Expr) -> Expr: ...
@overload
def sin(x: float) -> float: ...
@overload
def sin(x: Scalar) -> Scalar: ...
def sin(x: Any) -> Any:
    """The sine of an angle x in radians; of a plain number that is not finite nan."""
    return _circular("sin", x)


@overload
def cos(x: Expr) -> Expr: ...
@overload
def cos(x: float) -> float: ...
@overload
def cos(x: Scalar) -> Scalar: ...
def cos(x: Any) -> Any:
    """The cosine of an angle x in radians; of a plain number that is not finite nan."""
    return _circular("cos", x)


@overload
def power(x: Expr, y: Scalar) -> Expr: ...
@overload
def power(x: float, y: float) -> float: ...
@overload
def power(x: Scalar, y: Scalar) -> Scalar: ...
def power(x: Any, y: Any) -> Any:
    """``x ** y``; when y is an expression, ``exp(y * log(x))`` of a dimensionless, positive x."""
    if isinstance(y, Expr) and not y.constant:
        return exp(y * log(y.graph.expression(x)))
    exponent = float(y)
    if isinstance(x, Expr):
        return x.graph.power(x, exponent)
    if not isinstance(x, int | float):
        return _elementwise("power", x, exponent)
    try:
        result = x**exponent
    except ZeroDivisionError:
        return math.inf
    except OverflowError:
        return math.inf
    # in Python a fractional power of a negative number is complex
    return result if isinstance(result, float) else math.nan


@overload
def constant_like(value: float, x: Expr) -> Expr: ...
@overload
def constant_like(value: float, x: float) -> float: ...
@overload
def constant_like(value: float, x: Scalar) -> Scalar: ...
def constant_like(value: float, x: Scalar) -> Scalar:
    """The number `value` with the dimension of x, e.g. 15 degC to be subtracted from a temperature."""
    return x.graph.constant(value, dimension_of(x)) if isinstance(x, Expr) else float(value)


@overload
def absolute(x: Expr, width: Scalar) -> Expr: ...
@overload
def absolute(x: float, width: float) -> float: ...
@overload
def absolute(x: Scalar, width: Scalar) -> Scalar: ...
def absolute(x: Scalar, width: Scalar) -> Scalar:
    """``sqrt(x**2 + width**2)``: the smooth magnitude of x, never below `width`."""
    return sqrt(x * x + _width(width, x) ** 2)


@overload
def positive_part(x: Expr, width: Scalar) -> Expr: ...
@overload
def positive_part(x: float, width: float) -> float: ...
@overload
def positive_part(x: Scalar, width: Scalar) -> Scalar: ...
def positive_part(x: Scalar, width: Scalar) -> Scalar:
    """``(x + sqrt(x**2 + width**2)) / 2``: smooth max(x, 0); width/2 at the corner, always positive."""
    return 0.5 * (x + absolute(x, width))


@overload
def maximum(a: Expr, b: Scalar, width: Scalar) -> Expr: ...
@overload
def maximum(a: float, b: float, width: float) -> float: ...
@overload
def maximum(a: Scalar, b: Scalar, width: Scalar) -> Scalar: ...
def maximum(a: Scalar, b: Scalar, width: Scalar) -> Scalar:
    """``(a + b + sqrt((a - b)**2 + width**2)) / 2``: the smooth larger of two, never below either."""
    b = _like(b, a)
    return 0.5 * (a + b + absolute(a - b, width))


@overload
def minimum(a: Expr, b: Scalar, width: Scalar) -> Expr: ...
@overload
def minimum(a: float, b: float, width: float) -> float: ...
@overload
def minimum(a: Scalar, b: Scalar, width: Scalar) -> Scalar: ...
def minimum(a: Scalar, b: Scalar, width: Scalar) -> Scalar:
    """``(a + b - sqrt((a - b)**2 + width**2)) / 2``: the smooth smaller of two, never above either."""
    b = _like(b, a)
    return 0.5 * (a + b - absolute(a - b, width))


@overload
def signed_power(x: Expr, y: Scalar, width: Scalar) -> Expr: ...
@overload
def signed_power(x: float, y: float, width: float) -> float: ...
@overload
def signed_power(x: Scalar, y: Scalar, width: Scalar) -> Scalar: ...
def signed_power(x: Scalar, y: Scalar, width: Scalar) -> Scalar:
    """``x * (x**2 + width**2)**((y - 1)/2)``: smooth sign(x)·|x|**y, of a dimensionless x."""
    return x * power(x * x + _width(width, x) ** 2, 0.5 * (y - 1.0))


@overload
def smooth_sign(x: Expr, width: Scalar) -> Expr: ...
@overload
def smooth_sign(x: float, width: float) -> float: ...
@overload
def smooth_sign(x: Scalar, width: Scalar) -> Scalar: ...
def smooth_sign(x: Scalar, width: Scalar) -> Scalar:
    """``tanh(x / width)``: -1 below, 1 above, within 4 % at two widths."""
    return tanh(x / _width(width, x))


@overload
def smooth_step(x: Expr, width: Scalar) -> Expr: ...
@overload
def smooth_step(x: float, width: float) -> float: ...
@overload
def smooth_step(x: Scalar, width: Scalar) -> Scalar: ...
def smooth_step(x: Scalar, width: Scalar) -> Scalar:
    """``(1 + tanh(x / width)) / 2``: 0 below, 1 above, 1/2 at x = 0."""
    return 0.5 * (1.0 + smooth_sign(x, width))


def _width(width: Scalar, x: Scalar) -> Scalar:
    if not isinstance(width, Expr) and not width > 0.0:
        raise RigctlError("the width of a smooth switch must be positive", value=str(width))
    return _like(width, x)


def _like(value: Scalar, x: Scalar) -> Scalar:
    return value if isinstance(value, Expr) else constant_like(value, x)


def _circular(name: str, x: Any) -> Any:
    if isinstance(x, Expr):
        return x.graph.function(name, x)
    if not isinstance(x, int | float):
        return _elementwise(name, x)
    return float(getattr(math, name)(x)) if math.isfinite(x) else math.nan


def _elementwise(name: str, *args: Any) -> Any:
    """The NumPy function `name` of an array; out of range it is silently inf or nan, as for one number."""
    import numpy as np

    with np.errstate(all="ignore"):
        return getattr(np, name)(*args)
