"""A user's own effects: read from a YAML file, or made from a Python function.

Nothing in a file is executed: a term is parsed by rigctl's own parser and becomes symbols.
"""

from rigctl.effects.user.function import effect
from rigctl.effects.user.load import is_effect_file, load_effect, parse_effect

__all__ = ["effect", "is_effect_file", "load_effect", "parse_effect"]
