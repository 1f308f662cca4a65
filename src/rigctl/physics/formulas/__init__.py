"""Formulas in a user's files: parsed by rigctl's own parser, checked, and converted to the engine's symbols.

Nothing is executed. Only smooth formulas are accepted, because the solver and all derivatives require them.
"""

from rigctl.physics.formulas.corners import refuse_branch_words, refuse_corners
from rigctl.physics.formulas.lower import lower
from rigctl.physics.formulas.names import reserved_names, variable_types
from rigctl.physics.formulas.read import read_formula

__all__ = [
    "lower",
    "read_formula",
    "refuse_branch_words",
    "refuse_corners",
    "reserved_names",
    "variable_types",
]
