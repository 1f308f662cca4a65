"""A user's own family of models, read from a YAML file.

Nothing in the file is executed: formulas are parsed by rigctl's own parser and converted to symbols.
"""

from rigctl.physics.user.load import load_family, parse_family

__all__ = ["load_family", "parse_family"]
