"""A user's own family of models, read from a YAML file.

Nothing in the file is executed: a formula is read by rigctl's own parser and becomes symbols.
"""

from rigctl.physics.user.load import load_family, parse_family

__all__ = ["load_family", "parse_family"]
