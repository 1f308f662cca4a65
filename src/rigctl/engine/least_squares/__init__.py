"""Least squares over many records: shared parameters, and some that belong to one record each.

Independent of how residuals are computed: `least_squares` is given a function that returns, for every record,
its residuals and their derivatives.
"""

from rigctl.engine.least_squares.block import Block, Refused
from rigctl.engine.least_squares.identifiability import null_columns
from rigctl.engine.least_squares.multi_start import multi_start
from rigctl.engine.least_squares.result import Iteration, LeastSquaresResult, Outcome
from rigctl.engine.least_squares.solve import NoValueAtStart, least_squares
from rigctl.engine.least_squares.state import Options
from rigctl.engine.least_squares.uncertainty import slopes_of_minimum
from rigctl.engine.least_squares.unknown import Prior, Unknown, started

__all__ = [
    "Block",
    "Iteration",
    "LeastSquaresResult",
    "NoValueAtStart",
    "Options",
    "Outcome",
    "Prior",
    "Refused",
    "Unknown",
    "least_squares",
    "multi_start",
    "null_columns",
    "slopes_of_minimum",
    "started",
]
