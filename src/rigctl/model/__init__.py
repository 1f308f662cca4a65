"""A model: a family's base equations, effects, and the values of their parameters."""

from rigctl.model.build import Effects, build_system, superset
from rigctl.model.values import parameter_values

__all__ = ["Effects", "build_system", "parameter_values", "superset"]
