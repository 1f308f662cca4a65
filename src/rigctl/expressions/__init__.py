"""The restricted grammar of conditions and formulas in a user's files: parsed, checked, never executed."""

from rigctl.expressions.expression import Expression, parse
from rigctl.expressions.types import BOOLEAN, ValueType, type_of_unit

__all__ = ["BOOLEAN", "Expression", "ValueType", "parse", "type_of_unit"]
