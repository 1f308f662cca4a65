"""Formulas of a user's files: read by rigctl's own parser, checked, and turned into the engine's symbols.

Nothing is executed. A formula is smooth, because the solver and every derivative need it to be.
"""

from rigctl.physics.formulas.corners import refuse_branch_words, refuse_corners
from rigctl.physics.formulas.lower import lower
from rigctl.physics.formulas.names import CONSTANTS, reserved_names, variable_types
from rigctl.physics.formulas.read import read_formula

__all__ = [
    "CONSTANTS",
    "lower",
    "read_formula",
    "refuse_branch_words",
    "refuse_corners",
    "reserved_names",
    "variable_types",
]
