"""Symbolic expressions: one source for the number, the derivative, the printed equation, the dimension.

>>> from rigctl.units import DIMENSIONLESS
>>> graph = Graph()
>>> x = graph.variable("x", DIMENSIONLESS)
>>> to_text(derivative(exp(2 * x), x))
'2*exp(2*x)'
"""

from rigctl.engine.symbols.derivative import derivative
from rigctl.engine.symbols.dimension import check_dimension, dimension_of
from rigctl.engine.symbols.evaluate import evaluate
from rigctl.engine.symbols.expr import Expr, Scalar
from rigctl.engine.symbols.functions import (
    absolute,
    constant_like,
    cos,
    exp,
    log,
    maximum,
    minimum,
    positive_part,
    power,
    signed_power,
    sin,
    smooth_sign,
    smooth_step,
    sqrt,
    tanh,
)
from rigctl.engine.symbols.graph import Graph
from rigctl.engine.symbols.printing import to_latex, to_text
from rigctl.engine.symbols.substitute import substitute, variables_of

__all__ = [
    "Expr",
    "Graph",
    "Scalar",
    "absolute",
    "check_dimension",
    "constant_like",
    "cos",
    "derivative",
    "dimension_of",
    "evaluate",
    "exp",
    "log",
    "maximum",
    "minimum",
    "positive_part",
    "power",
    "signed_power",
    "sin",
    "smooth_sign",
    "smooth_step",
    "sqrt",
    "substitute",
    "tanh",
    "to_latex",
    "to_text",
    "variables_of",
]
